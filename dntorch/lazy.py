"""Names of a package that are imported when somebody first asks for them (PEP 562)."""

import sys
from collections.abc import Callable, Mapping
from importlib import import_module


def later(
    package: str, homes: Mapping[str, str]
) -> tuple[Callable[[str], object], Callable[[], list[str]]]:
    """The ``__getattr__`` and the ``__dir__`` of a package.

    Args:
        package: its ``__name__``.
        homes: for each name, the module of the package that holds it; a module holds itself.
    """
    module = sys.modules[package]

    def get(name: str) -> object:
        if name not in homes:
            raise AttributeError(
                f"module {package!r} has no attribute {name!r}", name=name, obj=module
            )
        home = import_module(f"{package}.{homes[name]}")
        value = getattr(home, name, home) if name == homes[name] else getattr(home, name)
        setattr(module, name, value)  # the next time it is there
        return value

    def names() -> list[str]:
        return sorted(vars(module).keys() | homes.keys())

    return get, names
