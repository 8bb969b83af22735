"""The contract of every structure: state in buffers, one pure step in continuous time.

A structure is an ``nn.Module`` whose *activation* lives in buffers and moves by a pure
function of inputs and state::

    output, state = module.step(input, state)     # pure: differentiable, vmap-able, exportable
    output = module(input)                        # get state, step, set state

Activation is forgotten by `reset` and is in no checkpoint; *long-term memory* (learned
values, memory traces) is a persistent buffer that only an explicit call erases.
"""

import copy
import math
from typing import TYPE_CHECKING, Any, ClassVar, Generic, TypeVar

import torch
from torch import Tensor, nn

from dntorch import declare
from dntorch.parameters import Parameters, check_batch

S = TypeVar("S")


class _Complete(type):
    """Completes a structure when its constructor, and that of every subclass, has run."""

    if not TYPE_CHECKING:

        def __call__(cls, *args, **kwargs):
            structure = super().__call__(*args, **kwargs)
            structure._complete()
            return structure


class Dynamics(Parameters, Generic[S], metaclass=_Complete):
    """Base of all structures. A subclass declares its state, and writes what is its own::

        class NodeState(NamedTuple):
            u: Tensor

        class Node(Dynamics[NodeState]):
            def __init__(self, tau: Number = 0.1, dt: float = 1 / 32) -> None:
                super().__init__(dt)
                self.tau = tau

            def check(self) -> None:
                check_time_constant("tau", self.tau, self.dt)

            def initial(self, batch: list[int]) -> NodeState:          # at rest
                return NodeState(self.origin.new_zeros(batch))

            def euler(self, input: Tensor, state: NodeState) -> NodeState:  # dt seconds later
                return NodeState(state.u.lerp(input, self.dt / self.tau))

            def output(self, state: NodeState) -> Tensor:              # a tensor of its own
                return state.u.clone()

    A field of the state bears the name of the attribute that holds it: a buffer (``Tensor``)
    or a part, another structure (the type of its state, or ``dict[str, Tensor]`` for a part of
    any type). From this follow

    ====================  ==================================================================
    ``state``             property: a snapshot of clones; setting it copies, in place
    ``step``, ``forward`` `euler` and ``output``; the same with the state in buffers
    ``initial``           of a composite whose fields are parts
    ``reset``             back to rest, in place; long-term memory and counts stay
    ``forget``            what ``lasting`` names becomes zero: what was learned, what was counted
    ``halfway``           between two states, for Heun's method
    ``flat``, ``nested``  the state as tensors by name, such as ``learner.trace.u``, and back
    ``write``             what setting ``state`` calls
    ====================  ==================================================================

    unless the subclass writes them itself.

    **Parameters** are the arguments of ``__init__`` that are kept under their own names. Those
    annotated ``float`` or `Number` must be finite, become floats, and are checked by ``check``
    whenever they are set; the others stay as they were built, but for those in ``settable``.
    A `Number` may be a tensor of the batch's shape ``(*batch,)``, one number per agent: it is a
    buffer (or, if it is one, an ``nn.Parameter``), so it moves with ``.to()``, is part of a
    snapshot and is split by ``select``. A name that is nearly that of a parameter is refused;
    all other attributes are free, for tools that hang something on modules.

    Attributes:
        dt: duration of one step, in seconds.
        origin: zeros of the batch's shape; carries batch, dtype and device of the activation.
        lasting: names of buffers that outlive ``reset``: long-term memory (persistent) and
            counts over the life of an agent (not persistent).
    """

    lasting: ClassVar[tuple[str, ...]] = ()

    if TYPE_CHECKING:
        state: S

        def initial(self, batch: list[int]) -> S: ...
        def write(self, state: S) -> None: ...
        def flat(self, state: S) -> dict[str, Tensor]: ...
        def nested(self, flat: dict[str, Tensor]) -> S: ...
        def halfway(self, start: S, end: S) -> S: ...
        def reset(self) -> None: ...
        def forget(self) -> None: ...

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        state = declare.state_type(cls, Dynamics)
        if state is not None:
            declare.write_plumbing(cls, state)
        declare.write_steps(cls)

    def __init__(self, dt: float) -> None:
        super().__init__()
        if isinstance(dt, (int, float)) and not dt > 0:
            raise ValueError(f"dt={dt} must be positive: give seconds per step, such as dt=1/32")
        self.dt = dt
        self.register_buffer("origin", torch.zeros(()), persistent=False)

    def _complete(self) -> None:
        """The end of construction: check, and allocate activation.

        The batch is that of numbers per agent and of parts that have learned in a batch.
        """
        for name in self._memory():
            if name not in self.lasting:
                raise ValueError(
                    f"{name} is a persistent buffer, long-term memory: name it in "
                    f"{type(self).__name__}.lasting, or register it with persistent=False"
                )
        self.check()
        self._rank = {name: buffer.dim() for name, buffer in self._memory().items()}
        self._ready = True
        _refuse_coarse_memory(self, self.origin.dtype)
        shapes = [number.shape for part in self.structures() for number in part._numbers().values()]
        for part, name in _memories(self):  # of parts that have a batch already
            memory = part._buffers[name]
            shapes.append(memory.shape[: memory.dim() - part._rank[name]])
        self.resize(*torch.broadcast_shapes(*shapes))

    @torch.jit.unused
    def structures(self) -> "list[Dynamics]":
        """This structure and all that it is composed of."""
        return [part for part in self.modules() if isinstance(part, Dynamics)]

    # ------------------------------------------------------------- batch

    @torch.jit.unused
    def resize(self, *batch: int) -> "Dynamics[S]":
        """Allocate activation at rest for leading dimensions ``batch``; returns the module.

        The only method that changes the shape of activation. Long-term memory stays as it is.
        Counts go on where ``batch`` extends the batch before, else they begin at 0.
        """
        check_batch(self, list(batch))
        with torch.inference_mode(False):
            state = self.initial(list(batch))  # may refuse: before anything changes
            self.register_buffer("origin", self.origin.new_zeros(batch), persistent=False)
            if isinstance(state, tuple):
                for name, value in state._asdict().items():
                    if isinstance(value, Tensor) and name not in self._memory():
                        self.register_buffer(name, value, persistent=False)
        for part in _direct_parts(self):
            part.resize(*batch)
        return self

    @torch.jit.unused
    def spread(self, *batch: int) -> "Dynamics[S]":
        """Resize to ``batch``, each member with a copy of the long-term memory, to learn alone."""
        check_batch(self, list(batch))
        spread = [(part, name, part._spread(name, batch)) for part, name in _memories(self)]
        for part, name, memory in spread:
            part.register_buffer(name, memory)
        return self.resize(*batch)

    def _spread(self, name: str, batch: tuple[int, ...]) -> Tensor:
        memory = self._buffers[name]
        own = list(memory.shape[: memory.dim() - self._rank[name]])
        if list(batch)[len(batch) - len(own) :] != own:
            raise ValueError(
                f"batch={list(batch)} does not fit {name} of batch {own}: call select(k) to keep "
                "that of one first"
            )
        with torch.inference_mode(False):
            return memory.expand(*batch, *memory.shape[len(own) :]).clone()

    @torch.jit.unused
    def select(self, index: int) -> "Dynamics[S]":
        """A new structure without batch, at rest, with what one member of a batch learned.

        Numbers per agent become that agent's, counts go on. Members count from 0 over all
        dimensions of the batch.
        """
        batch = tuple(self.origin.shape)
        if not batch:
            raise ValueError(f"index={index}: there is one set of weights only, nothing to select")
        count = math.prod(batch)
        if not -count <= index < count:
            raise ValueError(f"index={index}: give one of 0 to {count - 1}, the batch has {count}")

        def one(tensor: Tensor, rank: int) -> Tensor:
            own = tensor.shape[tensor.dim() - rank :]
            return tensor.expand(*batch, *own).reshape(count, *own)[index].clone()

        with torch.inference_mode(False):
            structure = copy.deepcopy(self)
            for part in structure.structures():
                for name in part.lasting:
                    buffer = part._buffers[name]
                    rank = part._rank.get(name, buffer.dim() - len(batch))
                    kept = one(buffer, rank)
                    part.register_buffer(name, kept, name in part._memory())
                for name, number in part._numbers().items():
                    value = one(number.detach(), 0)
                    learned = isinstance(number, nn.Parameter)
                    part._place(name, nn.Parameter(value) if learned else float(value))
            return structure.resize()

    def _memory(self) -> dict[str, Tensor]:
        """Long-term memory of this structure itself, without its parts."""
        fading = self._non_persistent_buffers_set
        return {name: x for name, x in self._buffers.items() if name not in fading}

    # ------------------------------------------------------------- copies

    @torch.jit.unused
    def snapshot(self) -> dict[str, Tensor]:
        """Copies of all buffers and parameters by name, for an exact resume."""
        return {name: tensor.detach().clone() for name, tensor in self._tensors().items()}

    @torch.jit.unused
    def restore(self, snapshot: dict[str, Tensor]) -> None:
        """Go on from a `snapshot` of a structure that was built alike and has the same batch."""
        held = self._tensors()
        for name in held.keys() | snapshot.keys():
            ours, theirs = held.get(name), snapshot.get(name)
            if ours is None or theirs is None or ours.shape != theirs.shape:
                raise ValueError(
                    f"the snapshot is of another architecture: {name} is "
                    f"{'missing' if theirs is None else list(theirs.shape)} there and "
                    f"{'missing' if ours is None else list(ours.shape)} here; build the structure "
                    "with the arguments and the version of dntorch it was saved with"
                )
        with torch.no_grad():
            for name, tensor in held.items():
                tensor.copy_(snapshot[name])

    def _tensors(self) -> dict[str, Tensor]:
        return dict([*self.named_buffers(), *self.named_parameters()])

    def register_buffer(self, name: str, tensor: Tensor | None, persistent: bool = True) -> None:
        # One made in inference mode could never be updated outside of it.
        if tensor is not None and tensor.is_inference():
            with torch.inference_mode(False):
                tensor = tensor.clone()
        super().register_buffer(name, tensor, persistent)

    def _apply(self, fn: Any, recurse: bool = True) -> "Dynamics[S]":
        with torch.inference_mode(False):
            _refuse_coarse_memory(self, fn(torch.zeros((), dtype=self.origin.dtype)).dtype)
            return super()._apply(fn, recurse)

    def __getstate__(self) -> dict[str, Any]:
        # A kernel made of tensors that want gradients is a buffer within their graph.
        cut = {k: x if x is None else x.detach() for k, x in self._buffers.items()}
        return self.__dict__ | {"_buffers": cut}

    def __setstate__(self, state: dict[str, Any]) -> None:
        super().__setstate__(state)
        for name, buffer in list(self._buffers.items()):
            self.register_buffer(name, buffer, name in self._memory())


def _direct_parts(module: nn.Module) -> list[Dynamics]:
    """Structures below a module that are in no other structure below it."""
    parts = []
    for child in module.children():
        parts += [child] if isinstance(child, Dynamics) else _direct_parts(child)
    return parts


def _memories(structure: Dynamics) -> list[tuple[Dynamics, str]]:
    return [(part, name) for part in structure.structures() for name in part._memory()]


def _refuse_coarse_memory(structure: Dynamics, dtype: torch.dtype) -> None:
    if dtype in (torch.float16, torch.bfloat16) and _memories(structure):
        _, name = _memories(structure)[0]
        raise ValueError(
            f"dtype={dtype} is too coarse for {name}: learned values would stand still, since "
            "what a step adds is rounded away; keep float32 or float64"
        )


def check_parts(whole: Dynamics, n: int, dt: float) -> None:
    """Raise unless the parts of a composite are for ``n`` behaviours and step by ``dt``."""
    for name, part in whole.named_children():
        if not isinstance(part, Dynamics):
            continue
        if abs(part.dt - dt) > 1e-9 * dt:
            raise ValueError(f"{name}.dt={part.dt} does not fit: build the part with dt={dt}")
        if getattr(part, "n", n) != n:
            raise ValueError(f"{name}.n={part.n} does not fit n={n}: build the part with n={n}")


def extended(memory: Tensor, rank: int, batch: list[int]) -> Tensor:
    """Long-term memory with ``rank`` dimensions of its own for each member of ``batch``."""
    own = list(memory.shape[: memory.dim() - rank])
    if batch[len(batch) - len(own) :] != own:
        raise ValueError(
            f"batch={batch} does not fit weights of batch {own}: call select(k) to keep those "
            "of one first"
        )
    return memory.expand(batch + list(memory.shape[memory.dim() - rank :])).clone()


def counted(count: Tensor, batch: list[int]) -> Tensor:
    """Counts go on for each member of ``batch``, or begin at 0 if these are other agents."""
    own = list(count.shape)
    if batch[len(batch) - len(own) :] != own:
        return torch.zeros(batch, dtype=count.dtype, device=count.device)
    return count.expand(batch).clone()
