"""The worlds in the registry of Gymnasium, whichever of the two packages is imported first."""

import sys
from importlib.machinery import ModuleSpec, PathFinder
from importlib.util import find_spec
from types import ModuleType

ENTRIES = {
    "dntorch/EPuck-v0": "dntorch.envs.epuck:EPuckEnv",
    "dntorch/Ring-v0": "dntorch.envs.ring_env:RingEnv",
}
"""What ``gymnasium.make`` imports, by its id."""


def register() -> None:
    """Make the ids of the worlds known to ``gymnasium.make``; harmless twice."""
    if find_spec("gymnasium") is None:
        return
    import gymnasium

    for name, entry in ENTRIES.items():
        if name not in gymnasium.registry:
            gymnasium.register(name, entry_point=entry)


def register_in_time() -> None:
    """Register now where Gymnasium is imported, and otherwise at the moment when it is.

    Importing it here would bring NumPy into every program, and into the shell's completion.
    """
    if sys.modules.get("gymnasium"):
        register()
    elif not any(isinstance(finder, _AfterGymnasium) for finder in sys.meta_path):
        sys.meta_path.insert(0, _AfterGymnasium())


class _AfterGymnasium:
    """Finds Gymnasium where Python finds it, and registers the worlds when it is executed."""

    def find_spec(self, name: str, path=None, target=None) -> ModuleSpec | None:
        spec = PathFinder.find_spec(name) if name == "gymnasium" else None
        if spec is None or spec.loader is None:
            return None
        execute = spec.loader.exec_module

        def execute_and_register(module: ModuleType) -> None:
            execute(module)
            register()

        spec.loader.exec_module = execute_and_register
        return spec
