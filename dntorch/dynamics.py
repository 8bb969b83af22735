"""The contract of every structure: state in buffers, one pure step in continuous time.

A structure is an ``nn.Module`` whose *activation* lives in buffers and moves by a pure
function of inputs and state::

    output, state = module.step(input, state)     # pure: differentiable, vmap-able, exportable
    output = module(input)                        # get state, step, set state

Activation is forgotten by `reset` and is in no checkpoint; *long-term memory* (learned
values, memory traces) is a persistent buffer that only an explicit call erases.
"""

from typing import TYPE_CHECKING, Any, Generic, TypeVar

import torch
from torch import Tensor, nn

from dntorch import declare, stepping
from dntorch.checks import check_count
from dntorch.parameters import check_batch
from dntorch.snapshots import Snapshots

S = TypeVar("S")


class _Complete(type):
    """Completes a structure when its constructor, and that of every subclass, has run."""

    if not TYPE_CHECKING:

        def __call__(cls, *args, **kwargs):
            structure = super().__call__(*args, **kwargs)
            structure._complete()
            return structure


class Dynamics(Snapshots, Generic[S], metaclass=_Complete):
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

    Each entry of the state has the name of the attribute that holds it: a buffer (``Tensor``)
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

    **Long-term memory** is any persistent buffer; ``lasting`` names it, and counts. It outlives
    ``reset``, and ``spread``, ``select`` and ``forget`` follow the parts. ``forward`` refuses
    inputs that would make it NaN or infinite; ``step`` is pure and looks at nothing.

    Attributes:
        dt: duration of one step, in seconds; that of all parts (``dt / substeps`` of a structure
            with sub-steps).
        origin: zeros of the batch's shape; carries batch, dtype and device of the activation.
    """

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
            cls._declared = state
        if state is not None or "lasting" in cls.__dict__:
            declare.write_plumbing(cls, cls._declared)
        stepping.write_steps(cls)

    def __init__(self, dt: float) -> None:
        super().__init__()
        self.dt = dt
        if not self.dt > 0:
            raise ValueError(f"dt={dt} must be positive: give seconds per step, such as dt=1/32")
        self.register_buffer("origin", torch.zeros(()), persistent=False)

    def _complete(self) -> None:
        """The end of construction: check, and allocate activation.

        The batch is that of numbers per agent and of parts that have learned in a batch.
        """
        self._check_declaration()
        self._check_all()
        self._note_memory()
        self._ready = True
        self.resize(*self._own_batch())
        self._long_term = (
            [] if self.cleans else sorted(self._learned() & self.flat(self.state).keys())
        )

    def _check_declaration(self) -> None:
        """Raise unless the class has all that a structure needs, and each part one place."""
        kind = type(self).__name__
        if not hasattr(type(self), "_declared"):
            raise TypeError(
                f"{kind} declares no state: write class {kind}(Dynamics[XState]) with a NamedTuple "
                "of tensors and states of parts"
            )
        needed = {"initial": "initial(batch)", "step": "euler(..., state), output(state)"}
        for name, lacking in needed.items():
            if not hasattr(type(self), name):
                raise TypeError(f"{kind} lacks {lacking}: see dntorch.Dynamics")
        places: dict[nn.Module, str] = {}
        for name, part in self.named_modules(remove_duplicate=False):
            if isinstance(part, Dynamics) and part in places:
                raise ValueError(
                    f"{places[part]} and {name} are one part, which can't have two states: give "
                    "each its own, such as copy.deepcopy(part)"
                )
            places[part] = name

    def _check_all(self) -> None:
        """`check`, and that all parts step together."""
        self.check()
        dt = self.dt / getattr(self, "substeps", 1)
        for name, part in _direct_parts(self):
            if abs(part.dt - dt) > 1e-9 * dt:
                raise ValueError(f"{name}.dt={part.dt} does not fit: build the part with dt={dt}")

    # ------------------------------------------------------------- batch

    @torch.jit.unused
    def resize(self, *batch: int) -> "Dynamics[S]":
        """Allocate activation at rest for leading dimensions ``batch``; returns the module.

        The only method that changes the shape of activation. Long-term memory stays as it is.
        Counts go on where ``batch`` extends the batch before, else they begin at 0.
        """
        for size in batch:
            check_count("batch", size, 0)
        check_batch(self, list(batch))
        with torch.inference_mode(False):
            state = self.initial(list(batch))  # may refuse: before anything changes
            self.register_buffer("origin", self.origin.new_zeros(batch), persistent=False)
            if isinstance(state, tuple):
                for name, value in state._asdict().items():
                    if isinstance(value, Tensor) and name not in self._memory():
                        self.register_buffer(name, value.detach().clone(), persistent=False)
        for _, part in _direct_parts(self):
            part.resize(*batch)
        return self


def _direct_parts(module: nn.Module, prefix: str = "") -> list[tuple[str, Dynamics]]:
    """Structures below a module that are in no other structure below it, with their names."""
    parts = []
    for name, child in module.named_children():
        single = isinstance(child, Dynamics)
        path = prefix + name
        parts += [(path, child)] if single else _direct_parts(child, path + ".")
    return parts


def check_parts(whole: Dynamics, n: int) -> None:
    """Raise unless the parts of a composite are for ``n`` behaviours."""
    for name, part in whole.named_children():
        if getattr(part, "n", n) != n:
            raise ValueError(f"{name}.n={part.n} does not fit n={n}: build the part with n={n}")
