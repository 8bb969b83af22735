"""Methods that follow from a declaration, written as attrs and dataclasses write ``__init__``.

The fields of a structure's state say all that its plumbing has to do. Here this becomes the
source of methods, one class at a time: plain code that TorchScript, Dynamo and a debugger
read like any other.
"""

import inspect
import itertools
import linecache
import sys
from types import ModuleType
from typing import Any, get_args, get_origin, get_type_hints

import torch
from torch import Tensor, nn

from dntorch.cells.integrators import halfway


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
    """Kind of each field of a state: ``tensor``, ``part`` or, of an open set of names, ``dict``."""
    kinds, hints = {}, get_type_hints(state)
    state.__annotations__.update(hints)  # TorchScript reads no strings
    for name, kind in hints.items():
        if name in RESERVED:
            raise ValueError(f"{state.__name__}.{name}: every structure has a {name}, rename it")
        many = get_origin(kind) is dict
        kinds[name] = "tensor" if kind is Tensor else "dict" if many else "part"
    return kinds


def write_plumbing(cls: type, state: Any) -> None:
    """All that moves, names and averages a state of this type."""
    names = {
        "State": state, "Tensor": Tensor, "overwrite": overwrite, "halfway": halfway,
        "within": within, "halfway_each": halfway_each, "remember": remember,
    }  # fmt: skip
    if get_origin(state) is dict:  # no field of its own; a structure with parts overrides these
        source = _source(
            ("state(self) -> State", ["state: State = {}", "return state"], "@property"),
            ("state(self, state: State) -> None", ["self.write(state)"], "@state.setter"),
            ("write(self, state: State) -> None", ["pass"], ""),
            ("initial(self, batch: list[int]) -> State", ["state: State = {}", "return state"], ""),
            ("flat(self, state: State) -> dict[str, Tensor]", ["return state"], ""),
            ("nested(self, flat: dict[str, Tensor]) -> State", ["return flat"], ""),
            ("halfway(self, start: State, end: State) -> State",
             ["return halfway_each(start, end)"], ""),
            ("reset(self) -> None", ["pass"], "@export"),
            ("forget(self) -> None", _forgotten(cls.lasting) or ["pass"], "@export"),
        )  # fmt: skip
    else:
        source = _fields_source(fields(state), cls.lasting)
    add_methods(cls, source, names)


def _fields_source(kinds: dict[str, str], lasting: tuple[str, ...]) -> str:
    """Source for a state with fields. Each kind of field has one expression per method."""
    held = {
        "tensor": "self.{0}.clone()", "part": "self.{0}.state",
        "dict": "self.{0}.flat(self.{0}.state)",
    }  # fmt: skip
    write = {
        "tensor": "overwrite(self.{0}, state.{0})", "part": "self.{0}.write(state.{0})",
        "dict": "self.{0}.write(self.{0}.nested(state.{0}))",
    }  # fmt: skip
    rest = {"part": "self.{0}.initial(batch)", "dict": "self.{0}.flat(self.{0}.initial(batch))"}
    flat = {
        "tensor": "flat['{0}'] = state.{0}",
        "part": "for name, x in self.{0}.flat(state.{0}).items():\n        flat['{0}.' + name] = x",
        "dict": "for name, x in state.{0}.items():\n        flat['{0}.' + name] = x",
    }
    nested = {
        "tensor": "flat['{0}']", "part": "self.{0}.nested(within(flat, '{0}.'))",
        "dict": "within(flat, '{0}.')",
    }  # fmt: skip
    middle = {
        "tensor": "halfway(start.{0}, end.{0})",
        "part": "self.{0}.halfway(start.{0}, end.{0})",
        "dict": "halfway_each(start.{0}, end.{0})",
    }

    def each(forms: dict[str, str]) -> list[str]:
        return [forms[kind].format(name) for name, kind in kinds.items()]

    def written(name: str, kind: str) -> str:
        return "remember(self.{0}, state.{0})" if name in lasting else write[kind]

    def whole(forms: dict[str, str]) -> list[str]:
        return [f"return State({', '.join(each(forms))})"]

    own = [name for name, kind in kinds.items() if kind == "tensor"]
    parts = [name for name, kind in kinds.items() if kind != "tensor"]
    fading = [name for name in own if name not in lasting]
    reset = [f"self.{name}.reset()" for name in parts]
    if fading:
        reset.append("rest = self.initial(list(self.origin.shape))")
        reset += [f"overwrite(self.{name}, rest.{name})" for name in fading]
    forget = _forgotten(lasting) + [f"self.{name}.forget()" for name in parts]
    methods = [
        ("state(self) -> State", whole(held), "@property"),
        ("state(self, state: State) -> None", ["self.write(state)"], "@state.setter"),
        ("write(self, state: State) -> None",
         [written(name, kind).format(name) for name, kind in kinds.items()], ""),
        ("flat(self, state: State) -> dict[str, Tensor]",
         ["flat: dict[str, Tensor] = {}", *each(flat), "return flat"], ""),
        ("nested(self, flat: dict[str, Tensor]) -> State", whole(nested), ""),
        ("halfway(self, start: State, end: State) -> State", whole(middle), ""),
        ("reset(self) -> None", reset or ["pass"], "@export"),
        ("forget(self) -> None", forget or ["pass"], "@export"),
    ]  # fmt: skip
    if not own:
        methods.append(("initial(self, batch: list[int]) -> State", whole(rest), ""))
    return _source(*methods)


def _forgotten(lasting: tuple[str, ...]) -> list[str]:
    return [f"self.{name}.zero_()" for name in lasting]


def _source(*methods: tuple[str, list[str], str]) -> str:
    return "\n".join(
        "\n".join([decorator] * bool(decorator) + [f"def {head}:"] + [f"    {x}" for x in body])
        for head, body, decorator in methods
    )


def write_steps(cls: type) -> None:
    """``step`` from ``euler`` and ``output``, ``forward`` from ``step``: the same inputs."""
    own = cls.__dict__
    changed = "euler" in own or "output" in own
    if changed and hasattr(cls, "euler") and hasattr(cls, "output") and _may_write(cls, "step"):
        takes, names, inputs = _inputs(cls.euler)
        names["Output"] = _hints(cls.output).get("return", Tensor)
        source = (
            f"def step(self, {takes}state: State) -> tuple[Output, State]:\n"
            f"    state = self.euler({inputs}state)\n"
            "    return self.output(state), state\n"
        )
        add_methods(cls, source, names)
    if "step" in cls.__dict__ and _may_write(cls, "forward"):
        takes, names, inputs = _inputs(cls.step)
        names["Output"] = (get_args(_hints(cls.step).get("return")) or (Tensor,))[0]
        source = (
            f"def forward(self, {takes.removesuffix(', ')}) -> Output:\n"
            f"    output, state = self.step({inputs}self.state)\n"
            "    self.write(state)\n"
            "    return output\n"
        )
        add_methods(cls, source, names)


def _may_write(cls: type, name: str) -> bool:
    """Whether a method is missing or was written here: one written by hand is kept."""
    if name in cls.__dict__:
        return False
    method = getattr(cls, name, None)
    return method is None or method is nn.Module.forward or hasattr(method, "generated")


def _hints(method: Any) -> dict[str, Any]:
    try:
        return get_type_hints(method)
    except NameError:  # a name that only a type checker can look up
        return method.__annotations__


def _inputs(method: Any) -> tuple[str, dict[str, Any], str]:
    """Parameters between ``self`` and ``state``: with types, the types by name, as arguments."""
    *inputs, state = list(inspect.signature(method).parameters.values())[1:]
    hints = _hints(method)
    kinds = {f"Input{k}": hints.get(each.name, Tensor) for k, each in enumerate(inputs)}
    takes = "".join(f"{each.name}: {kind}, " for each, kind in zip(inputs, kinds))
    kinds["State"] = hints.get(state.name, Tensor)
    return takes, kinds, "".join(f"{x.name}, " for x in inputs)


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


# What generated methods call.


def overwrite(buffer: Tensor, value: Tensor) -> None:
    """Write a new state into a buffer, in place, cut off from the graph.

    In place, since a rebound buffer is lost by ``torch.jit.trace`` and ``torch.export``.
    """
    if buffer.shape != value.shape:
        raise ValueError(
            f"state of shape {list(value.shape)} does not fit the buffer of shape "
            f"{list(buffer.shape)}: call resize(*batch) with the batch of the inputs first"
        )
    buffer.copy_(value.detach())


def remember(memory: Tensor, value: Tensor) -> None:
    """The same for what outlives a reset."""
    if memory.shape != value.shape:
        raise ValueError(
            f"values of shape {list(value.shape)} do not fit the memory of shape "
            f"{list(memory.shape)}: call spread(*batch) to give each its own"
        )
    memory.copy_(value.detach())


def within(flat: dict[str, Tensor], prefix: str) -> dict[str, Tensor]:
    """The tensors whose names begin with ``prefix``, without it."""
    found: dict[str, Tensor] = {}
    for name, x in flat.items():
        if name.startswith(prefix):
            found[name[len(prefix) :]] = x
    return found


def halfway_each(start: dict[str, Tensor], end: dict[str, Tensor]) -> dict[str, Tensor]:
    """`halfway` between two states by name."""
    middle: dict[str, Tensor] = {}
    for name, x in start.items():
        middle[name] = halfway(x, end[name])
    return middle
