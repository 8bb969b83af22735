"""What is put in the place of a structure's tensors: all of it, or nothing and one sentence."""

import math
from collections.abc import Mapping
from typing import Any, ClassVar

import torch
from torch import Tensor

from dntorch.memory import Memory, memories


class Snapshots(Memory):
    """A module whose tensors are copied, put back and loaded; see `dntorch.Dynamics`.

    Attributes:
        cleans: whether a step reads inputs that are not finite as 0, so that what was learned is
            safe. `forward` of all others looks at it before it is overwritten.
    """

    cleans: ClassVar[bool] = False
    _long_term: list[str]

    @torch.jit.unused
    def snapshot(self) -> dict[str, Tensor]:
        """Copies of all buffers and parameters by name, for an exact resume."""
        return {name: tensor.detach().clone() for name, tensor in self._tensors().items()}

    @torch.jit.unused
    def restore(self, snapshot: dict[str, Tensor]) -> None:
        """Go on from a `snapshot` of a structure that was built alike and has the same batch."""
        held = self._tensors()
        for name in {**held, **snapshot}:  # in one order: the same sentence each time
            ours, theirs = held.get(name), snapshot.get(name)
            if ours is None or theirs is None or ours.shape != theirs.shape:
                raise ValueError(
                    f"the snapshot is of another architecture: {name} is "
                    f"{'missing' if theirs is None else list(theirs.shape)} there and "
                    f"{'missing' if ours is None else list(ours.shape)} here; build the structure "
                    "with the arguments and the version of dntorch it was saved with"
                )
        lasting = set(self.state_dict())
        for name in lasting & held.keys():
            self._require_numbers(name, snapshot[name], held[name])
        before = self.snapshot()
        with torch.no_grad():
            for name, tensor in held.items():
                tensor.copy_(snapshot[name])
            try:
                for part in self._structures():
                    part._accept()
            except Exception:
                for name, tensor in held.items():
                    tensor.copy_(before[name])
                raise

    def _tensors(self) -> dict[str, Tensor]:
        return dict([*self.named_buffers(), *self.named_parameters()])

    # ------------------------------------------------------------- state

    @torch.jit.unused
    def _require_names(self, state: Any) -> tuple[dict[str, Tensor], dict[str, Tensor]]:
        """Raise unless a state has the tensors of this structure; its own and those given."""
        held = self._named(self.state)
        try:
            given = dict(self._named(state))
        except (AttributeError, TypeError, ValueError) as error:
            raise TypeError(
                f"state is a {type(state).__name__} ({error}): give what {type(self).__name__}"
                ".state or initial(batch) is"
            ) from None
        for name in sorted(held.keys() | given.keys()):
            if name not in given or name not in held:
                raise ValueError(
                    f"the state {_lacks(name, type(self).__name__, name in held)}: give what "
                    "state or initial(batch) is"
                )
        for name, value in given.items():
            if not isinstance(value, Tensor):
                raise TypeError(f"{name} in the state is a {type(value).__name__}: give a tensor")
            if value.is_complex():
                raise TypeError(f"{name} in the state of dtype {value.dtype}: give floats")
        return held, given

    @torch.jit.unused
    def _require_state(self, state: Any) -> None:
        """Raise unless a state is one of this structure, in its batch."""
        held, given = self._require_names(state)
        learned = self._learned()
        for name, own in held.items():
            value = given[name]
            if value.shape != own.shape:
                remedy = "spread(*batch) to give each its own" if name in learned else (
                    "resize(*batch) with the batch of the inputs first"
                )  # fmt: skip
                raise ValueError(
                    f"{name} of shape {list(value.shape)} does not fit the {list(own.shape)} of "
                    f"this structure: call {remedy}"
                )

    def _named(self, state: Any) -> dict[str, Tensor]:
        """The tensors of a state by the names that a user knows them by."""
        return self.flat(state)

    def _learned(self) -> set[str]:
        """Names of long-term memory in a flat state."""
        return {f"{path}.{name}".lstrip(".") for path, _, name in memories(self)}

    @torch.jit.unused
    def _write_or_restore(self, held: Any, state: Any) -> None:
        """`write`, or leave all as it was where a part of the new state does not fit."""
        try:
            self.write(state)
        except Exception:
            self.write(held)
            raise

    @torch.jit.unused
    def _require_finite(self, held: Any, state: Any, inputs: dict[str, Any]) -> None:
        """Raise unless what was learned stays finite: one bad number would erase it for ever."""
        if torch.compiler.is_compiling() or torch.jit.is_tracing():
            return
        flat = self.flat(state)
        for name in self._long_term:
            ahead = flat[name].detach()
            # A sum first, which is faster; one of finite numbers may be infinite.
            if ahead.is_meta or math.isfinite(ahead.sum()) or bool(ahead.isfinite().all()):
                continue
            seen: dict[str, Any] = {}
            for key, value in inputs.items():
                seen |= value if isinstance(value, Mapping) else {key: value}
            for key, value in seen.items():
                if isinstance(value, Tensor) and not bool(value.isfinite().all()):
                    raise ValueError(
                        f"{key} is not finite, and {name} would not be any more: give numbers; "
                        "nothing was changed"
                    )
            for key, value in self.flat(held).items():
                if not bool(value.isfinite().all()):
                    raise ValueError(
                        f"{key} is not finite, and {name} would not be any more: call reset(), "
                        "and look for the input that made it so"
                    )
            raise ValueError(f"{name} would grow beyond all numbers: give smaller inputs")

    # ------------------------------------------------------------- checkpoints

    def load_state_dict(
        self, state_dict: Mapping[str, Any], strict: bool = True, assign: bool = False
    ) -> Any:
        """Take over what another structure of the same architecture has learned, or nothing.

        Raises:
            ValueError: names (if ``strict``) or shapes of another architecture, values that are
                not finite, or numbers that the constructor would refuse.
        """
        own = super().state_dict().keys()
        for name in sorted(own ^ state_dict.keys()) if strict else ():
            raise ValueError(
                f"the state_dict {_lacks(name, type(self).__name__, name in own)}: build the "
                "structure with the arguments it was saved with, or give strict=False"
            )
        return super().load_state_dict(state_dict, strict, assign)

    def _load_from_state_dict(self, state_dict: dict[str, Any], prefix: str, *others: Any) -> None:
        # Also called for a structure within other modules; the whole of it, before its parts.
        self._require_loadable(state_dict, prefix)
        super()._load_from_state_dict(state_dict, prefix, *others)

    @staticmethod
    def _require_numbers(name: str, value: Tensor, held: Tensor) -> None:
        if not value.is_meta and not bool(value.to(held.dtype).isfinite().all()):
            raise ValueError(f"{name} is not finite: give what was saved before it became so")

    def _require_loadable(self, state_dict: dict[str, Any], prefix: str) -> None:
        """Raise unless all that a checkpoint has for this structure and its parts fits."""
        own = {k: x for k, x in super().state_dict(keep_vars=True).items() if torch.is_tensor(x)}
        own = {name: x for name, x in own.items() if prefix + name in state_dict}
        for name, held in own.items():
            value = state_dict[prefix + name]
            if not isinstance(value, Tensor):
                raise TypeError(f"{prefix}{name} is a {type(value).__name__}: give a tensor")
            if value.shape != held.shape:
                raise ValueError(
                    f"{prefix}{name} of shape {list(value.shape)} does not fit {list(held.shape)}: "
                    "build the structure with the sizes it was saved with; for another batch call "
                    "spread(*batch) or select(k) before"
                )
            self._require_numbers(prefix + name, value, held)
        numbers = {k: x.detach().clone() for k, x in own.items() if x.requires_grad}
        try:
            with torch.no_grad():
                for name in numbers:
                    own[name].copy_(state_dict[prefix + name])
            for part in self._structures():
                part._accept()
        finally:
            with torch.no_grad():
                for name, value in numbers.items():
                    own[name].copy_(value)


def _lacks(name: str, owner: str, owned: bool) -> str:
    """What stands in a sentence between the name of something and the remedy."""
    there, here = ("no", "one") if owned else ("one", "no")
    return f"has {there} {name}, {owner} has {here}"
