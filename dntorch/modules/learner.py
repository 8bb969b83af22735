"""The reinforcement learner: from transitions between behaviours to their values."""

from typing import NamedTuple

import torch
from torch import Tensor

from dntorch.cells.coincidence import coincidence
from dntorch.cells.hebbian import HebbianState
from dntorch.cells.opposition import OppositionState
from dntorch.cells.transient import TransientState
from dntorch.cells.working_memory import WorkingMemoryState
from dntorch.checks import check_count, check_ends, check_states
from dntorch.dynamics import Dynamics, check_parts
from dntorch.modules.hebbian import HebbianQ
from dntorch.modules.opposition import ValueOpposition
from dntorch.modules.transient import TPCell
from dntorch.modules.working_memory import ItemOrderWM
from dntorch.number import Number, span, wide


class LearnerState(NamedTuple):
    pulses: TransientState
    trace: WorkingMemoryState
    opposition: OppositionState
    values: HebbianState


class Learner(Dynamics[LearnerState]):
    r"""SARSA(:math:`\lambda`) as neural dynamics over pairs (action i, state j).

    =====================  ==============  ==================================================
    stage                  here            what it does
    =====================  ==============  ==================================================
    state-action cells     `coincidence`   :math:`I_{ij}`: intention i runs in state j
    transient pulse cells  ``pulses``      onset and offset of each pair
    item-and-order memory  ``trace``       eligibility of the pairs of the recent past
    value opposition       ``opposition``  :math:`v \to \gamma Q(s',a') - Q(s,a)`
    Hebbian values         ``values``      :math:`\dot W = \eta (1 - I)(r + v) u`
    =====================  ==============  ==================================================

    All stages read the activation of time t, then all are updated.

    ``coincidence_threshold`` may be a tensor ``(*batch,)``, one number per agent.

    A state is the behaviour that was completed last: ``context`` is the firing rates of the CoS
    nodes. With a `Recall` it is the context of more of them, in which the last one counts first.

    Shapes: ``intention`` ``(*batch, n)``, ``context`` ``(*batch, states)``, ``reward``
    ``(*batch,)``, output (weights ``[action, state]`` after the step) ``(*batch, n, states)``.
    State: ``LearnerState(pulses, trace, opposition, values)``.

    Args:
        n: number of behaviours.
        states: how many states, a multiple of n; by default n.
        pulses, trace, opposition, values: stages with other parameters than the defaults.
        coincidence_threshold: :math:`\theta` of the state-action cells, within (0, 1).

    Raises:
        ValueError: a stage of another size or ``dt``; inputs of other sizes.

    Source: section III.C of Kazerounian, Luciw, Richter and Sandamirskaya, "Autonomous
    Reinforcement of Behavioral Sequences in Neural Dynamics".

    **Deviation**: the printed state-action cell (eq. 6) multiplies a sum over the *other*
    nodes with a Heaviside that is always one, since :math:`f_S > 0`; here it is the
    coincidence that the text describes. A pair (i, i) does not exist. Other states than the last
    completed behaviour are not in the paper.
    """

    off_diagonal: Tensor

    def __init__(
        self,
        n: int,
        pulses: TPCell | None = None,
        trace: ItemOrderWM | None = None,
        opposition: ValueOpposition | None = None,
        values: HebbianQ | None = None,
        coincidence_threshold: Number = 0.5,
        states: int | None = None,
        dt: float = 1 / 32,
    ) -> None:
        super().__init__(dt)
        check_count("n", n, 2)
        self.n, self.coincidence_threshold = n, coincidence_threshold
        self.states = check_states(n, states)
        last = torch.eye(n).repeat_interleave(self.states // n, -1)
        self.register_buffer("off_diagonal", 1 - last, persistent=False)
        self.pulses = pulses or TPCell((n, self.states), dt=dt)
        self.trace = trace or ItemOrderWM(n, states=self.states, dt=dt)
        self.opposition = opposition or ValueOpposition(n, states=self.states, dt=dt)
        self.values = values or HebbianQ(n, states=self.states, dt=dt)

    def check(self) -> None:
        low, high = span(self.coincidence_threshold)
        if not 0 < low <= high < 1:
            raise ValueError(
                f"coincidence_threshold={low if low <= 0 else high}: give a number between 0 and 1"
            )
        check_parts(self, self.n)
        n, states, shape = self.n, self.states, tuple(self.pulses.shape)
        if shape != (n, states):
            raise ValueError(f"pulses.shape={shape} does not fit: build TPCell(({n}, {states}))")
        for name in ("trace", "opposition", "values"):
            part = getattr(self, name)
            if part.states != states:
                raise ValueError(
                    f"{name}.states={part.states} does not fit states={states}: build the part "
                    f"with states={states}"
                )

    def active(self, intention: Tensor, context: Tensor) -> Tensor:
        """State-action cells: which pair runs, ``(*batch, n, states)``."""
        threshold = wide(self.coincidence_threshold, 2)
        return coincidence(intention, context, self.off_diagonal, threshold)

    def output(self, state: LearnerState) -> Tensor:
        return self.values.output(state.values)

    def euler(
        self, intention: Tensor, context: Tensor, reward: Tensor, state: LearnerState
    ) -> LearnerState:
        check_ends("intention", intention, [self.n])
        check_ends("context", context, [self.states])
        active = self.active(intention, context)
        pulse, trace, weights = state.pulses.pulse, state.trace.u, state.values.weights
        return LearnerState(
            self.pulses.euler(active, state.pulses),
            self.trace.euler(pulse, state.trace),
            self.opposition.euler(pulse, trace, weights, state.opposition),
            self.values.euler(active, trace, state.opposition.error, reward, state.values),
        )
