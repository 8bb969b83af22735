"""Models of COSIVINA, a MATLAB toolbox for dynamic fields: load its files, and save to them.

Each name is imported, and PyTorch with it, when it is first asked for.
"""

from typing import TYPE_CHECKING

from dntorch.lazy import later

if TYPE_CHECKING:
    from dntorch.cosivina.loading import load, noise
    from dntorch.cosivina.saving import save
else:  # the same, later
    __getattr__, __dir__ = later(
        __name__, {"load": "loading", "noise": "loading", "save": "saving"}
    )

__all__ = ["load", "noise", "save"]
