"""Methods that follow from a declaration, written as attrs and dataclasses write ``__init__``.

The entries of a structure's state say all that its plumbing has to do. Here this becomes the
source of methods, one class at a time: plain code that TorchScript, Dynamo and a debugger
read like any other.
"""

import itertools
import linecache
import sys
from types import ModuleType
from typing import Any, get_args, get_origin, get_type_hints

import torch
from torch import Tensor

from dntorch.plumbing import beneath, halfway, halfway_each, overwrite, remember, within


def state_type(cls: type, base: type) -> Any:
    """``S`` of ``class X(base[S])``, or None where a class declares no state of its own."""
    state = _argument(cls, base)
    return state if hasattr(state, "_fields") or get_origin(state) is dict else None


def _argument(cls: type, base: type) -> Any:
    """What stands for ``S``, through generic classes between ``cls`` and ``base``."""
    for parent in cls.__dict__.get("__orig_bases__", ()):
        origin, given = get_origin(parent), get_args(parent)
        if origin is base:
            return given[0]
        if isinstance(origin, type) and issubclass(origin, base):
            inner = _argument(origin, base)
            if inner in origin.__parameters__:
                return given[origin.__parameters__.index(inner)]
    return None


RESERVED = ("state", "flat", "nested", "write", "initial", "step", "forward", "origin", "dt")


def fields(state: Any) -> dict[str, str]:
    """Kind of each entry of a state: ``tensor``, ``part`` or, of an open set of names, ``dict``."""
    kinds, hints = {}, get_type_hints(state)
    state.__annotations__.update(hints)  # TorchScript reads no strings
    for name, kind in hints.items():
        if name in RESERVED:
            raise ValueError(f"{state.__name__}.{name}: every structure has a {name}, rename it")
        many = get_origin(kind) is dict
        kinds[name] = "tensor" if kind is Tensor else "dict" if many else "part"
    return kinds


#: For each kind of entry, what one method does with the entry called ``{0}``.
FORMS = {
    "tensor": {
        "held": "self.{0}.clone()",
        "write": "overwrite(self.{0}, state.{0})",
        "flat": "flat['{0}'] = state.{0}",
        "nested": "flat['{0}']",
        "halfway": "halfway(start.{0}, end.{0})",
    },
    "part": {
        "held": "self.{0}.state",
        "write": "self.{0}.write(state.{0})",
        "rest": "self.{0}.initial(batch)",
        "flat": "flat.update(beneath('{0}', self.{0}.flat(state.{0})))",
        "nested": "self.{0}.nested(within(flat, '{0}.'))",
        "halfway": "self.{0}.halfway(start.{0}, end.{0})",
    },
    "dict": {
        "held": "held_{0}",
        "write": "if self.{0} is not None: self.{0}.write(self.{0}.nested(state.{0}))",
        "rest": "rest_{0}",
        "flat": "flat.update(beneath('{0}', state.{0}))",
        "nested": "within(flat, '{0}.')",
        "halfway": "halfway_each(start.{0}, end.{0})",
    },
}
#: What comes before, for an entry that is a ``dict``: its part may be None.
AHEAD = {
    "held": [
        "held_{0}: dict[str, Tensor] = {{}}",
        "if self.{0} is not None: held_{0} = self.{0}.flat(self.{0}.state)",
    ],
    "rest": [
        "rest_{0}: dict[str, Tensor] = {{}}",
        "if self.{0} is not None: rest_{0} = self.{0}.flat(self.{0}.initial(batch))",
    ],
}
HEADS = {
    "state": "state(self) -> State",
    "set": "state(self, state: State) -> None",
    "write": "write(self, state: State) -> None",
    "initial": "initial(self, batch: list[int]) -> State",
    "flat": "flat(self, state: State) -> dict[str, Tensor]",
    "nested": "nested(self, flat: dict[str, Tensor]) -> State",
    "halfway": "halfway(self, start: State, end: State) -> State",
    "reset": "reset(self) -> None",
    "forget": "forget(self) -> None",
}
DECORATORS = {"state": "@property", "set": "@state.setter", "reset": "@export", "forget": "@export"}


def write_plumbing(cls: type, state: Any) -> None:
    """All that moves, names and averages a state of this type."""
    open_names = get_origin(state) is dict
    bodies = _open_bodies() if open_names else _bodies(fields(state), cls.lasting)
    bodies["set"] = [
        "if not torch.jit.is_scripting():",
        "    self._require_state(state)",
        "self.write(state)",
    ]
    bodies["forget"] = [f"self.{name}.zero_()" for name in cls.lasting] + bodies["forget"]
    source = ""
    for name, head in HEADS.items():
        if name in bodies:
            lines = [f"    {line}" for line in bodies[name] or ["pass"]]
            source += "\n".join([DECORATORS.get(name, ""), f"def {head}:", *lines, ""])
    functions = (overwrite, remember, halfway, halfway_each, beneath, within)
    add_methods(
        cls,
        source,
        {"torch": torch, "State": state, "Tensor": Tensor} | {f.__name__: f for f in functions},
    )


def _bodies(kinds: dict[str, str], lasting: tuple[str, ...]) -> dict[str, list[str]]:
    """Lines of each method for a state with these entries."""

    def each(method: str) -> list[str]:
        return [FORMS[kind][method].format(name) for name, kind in kinds.items()]

    def whole(method: str) -> list[str]:
        return [*ahead(method), f"return State({', '.join(each(method))})"]

    def ahead(method: str) -> list[str]:
        """Of parts of any type, which may be missing: TorchScript has no conditional value."""
        given = AHEAD.get(method)
        names = [name for name, kind in kinds.items() if kind == "dict"] if given else []
        return [line.format(name) for name in names for line in given]

    def there(name: str) -> str:
        return f"if self.{name} is not None: " if kinds[name] == "dict" else ""

    own = [name for name, kind in kinds.items() if kind == "tensor"]
    parts = [name for name in kinds if name not in own]
    fading = [f"overwrite(self.{name}, rest.{name})" for name in own if name not in lasting]
    rest = ["rest = self.initial(list(self.origin.shape))"] if fading else []
    return {
        "state": whole("held"),
        "write": [
            f"remember(self.{name}, state.{name})" if name in lasting else line
            for name, line in zip(kinds, each("write"))
        ],
        "flat": ["flat: dict[str, Tensor] = {}", *each("flat"), "return flat"],
        "nested": whole("nested"),
        "halfway": whole("halfway"),
        "reset": [*(f"{there(name)}self.{name}.reset()" for name in parts), *rest, *fading],
        "forget": [f"{there(name)}self.{name}.forget()" for name in parts],
    } | ({} if own else {"initial": whole("rest")})


def _open_bodies() -> dict[str, list[str]]:
    """The same for ``dict[str, Tensor]``: no entry; a structure with parts writes its own."""
    none = ["state: State = {}", "return state"]
    return {
        "state": none, "write": [], "initial": none, "flat": ["return state"],
        "nested": ["return flat"], "halfway": ["return halfway_each(start, end)"], "reset": [],
        "forget": [],
    }  # fmt: skip


def add_methods(cls: type, source: str, names: dict[str, Any]) -> None:
    """Run ``source`` and add the methods it defines, except those that the class has written.

    The methods share a module that ``sys.modules`` knows, with ``names`` in it: TorchScript
    looks up types there, Dynamo the module.
    """
    place = f"{cls.__module__}.<{cls.__qualname__} {next(_numbers)}>"
    module = sys.modules[place] = ModuleType(place)
    vars(module).update(names, export=torch.jit.export)
    linecache.cache[place] = (len(source), None, source.splitlines(True), place)
    exec(compile(source, place, "exec"), vars(module), made := {})
    for name, method in made.items():
        if name not in cls.__dict__:
            accessors = (method.fget, method.fset) if isinstance(method, property) else (method,)
            for function in accessors:
                function.generated = True
                function.__module__, function.__qualname__ = (
                    cls.__module__, f"{cls.__qualname__}.{name}",
                )  # fmt: skip
            setattr(cls, name, method)


_numbers = itertools.count()
