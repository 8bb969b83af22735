"""Packages that come with an extra: asked for before any work begins."""

from importlib.util import find_spec

EXTRAS = {
    "tqdm": "cli", "numpy": "cli", "matplotlib": "cli", "jinja2": "cli",
    "pybullet": "sim", "gymnasium": "sim", "cv2": "sim",
    "serial": "robot",
    "onnx": "export", "onnxscript": "export", "executorch": "executorch",
    "scipy": "stats", "statsmodels": "stats",
    "torchrl": "rl", "bokeh": "view", "tensorboard": "log", "ray": "ray", "submitit": "slurm",
}  # fmt: skip
"""The extra of ``pip install 'dntorch[EXTRA]'`` that brings a package, by what is imported."""


def has(package: str) -> bool:
    """Whether a package can be imported here."""
    try:
        return find_spec(package) is not None
    except (ImportError, ValueError):
        return False


def require(*packages: str, instead: str = "") -> None:
    """Raise unless all of them can be imported; ``instead`` is what to do without them.

    Raises:
        ImportError: the sentence says what to install.
    """
    missing = [name for name in packages if not has(name)]
    if missing:
        extras = ",".join(dict.fromkeys(EXTRAS[name] for name in missing))
        verb = "is" if len(missing) == 1 else "are"
        raise ImportError(
            f"{', '.join(missing)} {verb} not installed: run pip install 'dntorch[{extras}]'"
            f"{instead and ', or ' + instead}"
        )
