"""``step`` and ``forward``, which follow from what a structure writes of one step.

Their source is written as that of the plumbing (`dntorch.declare`).
"""

import inspect
from typing import Any, get_args, get_type_hints

import torch
from torch import Tensor, nn

from dntorch.declare import add_methods


def write_steps(cls: type) -> None:
    """``step`` from ``euler`` and ``output``, ``forward`` from ``step``: the same inputs."""
    own = cls.__dict__
    if "euler" in own and "relax" not in own and hasattr(cls, "relax"):
        raise TypeError(
            f"{cls.__name__} writes euler, which composites do not call: write relax, with the "
            "output before state, and euler follows"
        )
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
        names["torch"] = torch
        named = "".join(f"'{name.strip()}': {name}, " for name in inputs.split(",")[:-1])
        names["Output"] = (get_args(_hints(cls.step).get("return")) or (Tensor,))[0]
        source = (
            f"def forward(self, {takes.removesuffix(', ')}) -> Output:\n"
            "    held_ = self.state\n"
            f"    output, state = self.step({inputs}held_)\n"
            "    if torch.jit.is_scripting():\n"
            "        self.write(state)\n"
            "    else:\n"
            "        if self._long_term:\n"
            f"            self._require_finite(held_, state, {{{named}}})\n"
            "        self._write_or_restore(held_, state)\n"
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
