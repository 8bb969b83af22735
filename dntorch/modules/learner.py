"""The reinforcement learner: from transitions between behaviours to their values."""

from typing import NamedTuple

import torch
from torch import Tensor

from dntorch.cells.coincidence import coincidence
from dntorch.cells.hebbian import HebbianState
from dntorch.cells.opposition import OppositionState
from dntorch.cells.transient import TransientState
from dntorch.cells.working_memory import WorkingMemoryState
from dntorch.dynamics import Dynamics, check_ends, check_parts
from dntorch.modules.hebbian import HebbianQ
from dntorch.modules.opposition import ValueOpposition
from dntorch.modules.transient import TPCell
from dntorch.modules.working_memory import ItemOrderWM


class LearnerState(NamedTuple):
    pulses: TransientState
    trace: WorkingMemoryState
    opposition: OppositionState
    values: HebbianState


class Learner(Dynamics):
    r"""SARSA(:math:`\lambda`) as neural dynamics over pairs (action i, state j).

    =====================  ==============  ==================================================
    stage                  here            what it does
    =====================  ==============  ==================================================
    state-action cells     `coincidence`   :math:`I_{ij}`: intention i runs, j was completed
    transient pulse cells  ``pulses``      onset and offset of each pair
    item-and-order memory  ``trace``       eligibility of the pairs of the recent past
    value opposition       ``opposition``  :math:`v \to \gamma Q(s',a') - Q(s,a)`
    Hebbian values         ``values``      :math:`\dot W = \eta (1 - I)(r + v) u`
    =====================  ==============  ==================================================

    All stages read the activation of time t, then all are updated.

    Shapes: ``intention`` and ``satisfaction`` (firing rates) ``(*batch, n)``, ``reward``
    ``(*batch,)``, output (weights ``[action, state]`` after the step) ``(*batch, n, n)``.
    State: ``LearnerState(pulses, trace, opposition, values)``.

    Args:
        n: number of behaviours.
        pulses, trace, opposition, values: stages with other parameters than the defaults.
        coincidence_threshold: :math:`\theta` of the state-action cells, within (0, 1).

    Raises:
        ValueError: a stage of another size or ``dt``; inputs of other sizes.

    Source: section III.C of Kazerounian, Luciw, Richter and Sandamirskaya, "Autonomous
    Reinforcement of Behavioral Sequences in Neural Dynamics".

    **Deviation**: the printed state-action cell (eq. 6) multiplies a sum over the *other*
    nodes with a Heaviside that is always one, since :math:`f_S > 0`; here it is the
    coincidence that the text describes. A pair (i, i) does not exist.
    """

    off_diagonal: Tensor

    def __init__(
        self,
        n: int,
        pulses: TPCell | None = None,
        trace: ItemOrderWM | None = None,
        opposition: ValueOpposition | None = None,
        values: HebbianQ | None = None,
        coincidence_threshold: float = 0.5,
        dt: float = 1 / 32,
    ) -> None:
        super().__init__(dt)
        if not 0 < coincidence_threshold < 1:
            raise ValueError(
                f"coincidence_threshold={coincidence_threshold}: give a number between 0 and 1"
            )
        self.n, self.coincidence_threshold = n, coincidence_threshold
        self.register_buffer("off_diagonal", 1 - torch.eye(n), persistent=False)
        self.pulses = pulses or TPCell((n, n), dt=dt)
        self.trace = trace or ItemOrderWM(n, dt=dt)
        self.opposition = opposition or ValueOpposition(n, dt=dt)
        self.values = values or HebbianQ(n, dt=dt)
        check_parts(self, n, dt)
        if tuple(self.pulses.shape) != (n, n):
            raise ValueError(
                f"pulses.shape={tuple(self.pulses.shape)} does not fit: build TPCell(({n}, {n}))"
            )

    @property
    def state(self) -> LearnerState:
        return LearnerState(
            self.pulses.state, self.trace.state, self.opposition.state, self.values.state
        )

    @state.setter
    def state(self, state: LearnerState) -> None:
        self.pulses.state = state.pulses
        self.trace.state = state.trace
        self.opposition.state = state.opposition
        self.values.state = state.values

    def initial(self, batch: list[int]) -> LearnerState:
        return LearnerState(
            self.pulses.initial(batch),
            self.trace.initial(batch),
            self.opposition.initial(batch),
            self.values.initial(batch),
        )

    @torch.jit.export
    def reset(self) -> None:
        self.pulses.reset()
        self.trace.reset()
        self.opposition.reset()

    def forward(self, intention: Tensor, satisfaction: Tensor, reward: Tensor) -> Tensor:
        output, self.state = self.step(intention, satisfaction, reward, self.state)
        return output

    def active(self, intention: Tensor, satisfaction: Tensor) -> Tensor:
        """State-action cells: which pair runs, ``(*batch, n, n)``."""
        return coincidence(intention, satisfaction, self.off_diagonal, self.coincidence_threshold)

    def step(
        self, intention: Tensor, satisfaction: Tensor, reward: Tensor, state: LearnerState
    ) -> tuple[Tensor, LearnerState]:
        check_ends("intention", intention, [self.n])
        check_ends("satisfaction", satisfaction, [self.n])
        active = self.active(intention, satisfaction)
        pulse, trace, weights = state.pulses.pulse, state.trace.u, state.values.weights
        _, pulses = self.pulses.step(active, state.pulses)
        _, memory = self.trace.step(pulse, state.trace)
        _, opposition = self.opposition.step(pulse, trace, weights, state.opposition)
        weights, values = self.values.step(
            active, trace, state.opposition.error, reward, state.values
        )
        return weights, LearnerState(pulses, memory, opposition, values)
