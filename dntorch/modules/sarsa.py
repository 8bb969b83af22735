"""The whole agent: DN-SARSA(lambda)."""

import copy
from typing import NamedTuple

import torch
from torch import Tensor

from dntorch.cells.functions import came_on
from dntorch.cells.hebbian import HebbianState
from dntorch.cells.integrators import check_integrator, halfway
from dntorch.cells.node import NodeState
from dntorch.cells.opposition import OppositionState
from dntorch.cells.transient import TransientState
from dntorch.cells.value import ValueState
from dntorch.cells.working_memory import WorkingMemoryState
from dntorch.dynamics import Dynamics, check_ends, check_parts, overwrite
from dntorch.modules.behaviors import BehaviorState, ElementaryBehaviors
from dntorch.modules.learner import Learner, LearnerState
from dntorch.modules.sensorimotor import Direct
from dntorch.modules.value import ValueNodes


class AgentState(NamedTuple):
    sensorimotor: dict[str, Tensor]
    behaviors: BehaviorState
    value_nodes: ValueState
    learner: LearnerState
    decisions: Tensor
    """Number of behaviours completed so far, ``(*batch,)``, int64: one decision follows each."""


class DNSarsa(Dynamics):
    r"""An agent that learns a rewarding sequence of behaviours from delayed reward.

    Composes the paper's architecture::

        observation -> sensorimotor -> match -> behaviors -> pairs -> pulses -> trace
                            ^                    |    ^                           |
        action <------------+---- intention -----+    +--- value nodes <- values <+- opposition
                                                                            ^
                                                                          reward

    Every part reads the activation of time t, then all are updated (synchronous Euler with
    ``substeps`` inside a control step, or Heun).

    Args:
        n: number of behaviours.
        sensorimotor: what turns observations into matches and intentions into actions,
            by default `Direct`.
        behaviors, value_nodes, learner: parts with other parameters than the defaults;
            their ``dt`` must be ``dt / substeps``.
        dt: seconds a control step.
        substeps: integrator steps in a control step, with the same inputs.
        integrator: ``"euler"`` or ``"heun"``.

    Shapes: ``observation`` as the sensorimotor part wants it, ``reward`` ``(*batch,)``,
    ``noise`` on the value weights ``(*batch, n, n)`` (see `dntorch.noise.Exploration`;
    zeros are exploitation); the output is the action.
    State: `AgentState`, at rest but for the long-term memory of values.

    Raises:
        ValueError: a part of another size or with another ``dt``.
        TypeError: a sensorimotor part that is no `Dynamics`.

    Source: Fig. 1 and section III of Kazerounian, Luciw, Richter and Sandamirskaya,
    "Autonomous Reinforcement of Behavioral Sequences in Neural Dynamics". Deviations: those
    of the parts.

    >>> agent = DNSarsa(2)
    >>> match = torch.tensor([0.0, 0.0])  # nothing found yet: the agent starts to want something
    >>> for _ in range(64):
    ...     intention = agent(match, torch.tensor(0.0), torch.zeros(2, 2))
    >>> int((intention > 0.5).sum())
    1
    """

    decisions: Tensor

    def __init__(
        self,
        n: int,
        sensorimotor: Dynamics | None = None,
        behaviors: ElementaryBehaviors | None = None,
        value_nodes: ValueNodes | None = None,
        learner: Learner | None = None,
        dt: float = 1 / 32,
        substeps: int = 1,
        integrator: str = "euler",
    ) -> None:
        super().__init__(dt)
        check_integrator(integrator, substeps)
        self.n, self.substeps, self.heun = n, substeps, integrator == "heun"
        fine = dt / substeps
        if not isinstance(sensorimotor, Dynamics | None):
            raise TypeError(
                f"sensorimotor={sensorimotor} is no Dynamics: write it as `Direct` is written"
            )
        self.sensorimotor = sensorimotor or Direct(dt=fine)
        self.behaviors = behaviors or ElementaryBehaviors(n, dt=fine)
        self.value_nodes = value_nodes or ValueNodes(n, dt=fine)
        self.learner = learner or Learner(n, dt=fine)
        check_parts(self, n, fine)
        self.resize()

    @property
    def state(self) -> AgentState:
        return AgentState(
            self.sensorimotor.state,
            self.behaviors.state,
            self.value_nodes.state,
            self.learner.state,
            self.decisions.clone(),
        )

    @state.setter
    def state(self, state: AgentState) -> None:
        self.sensorimotor.state = state.sensorimotor
        self.behaviors.state = state.behaviors
        self.value_nodes.state = state.value_nodes
        self.learner.state = state.learner
        overwrite(self.decisions, state.decisions)

    def initial(self, batch: list[int]) -> AgentState:
        return AgentState(
            self.sensorimotor.initial(batch),
            self.behaviors.initial(batch),
            self.value_nodes.initial(batch),
            self.learner.initial(batch),
            torch.zeros(batch, dtype=torch.int64, device=self.origin.device),
        )

    @torch.jit.export
    def reset(self) -> None:
        """Put the activation back to rest, in place. What was learned stays."""
        self.sensorimotor.reset()
        self.behaviors.reset()
        self.value_nodes.reset()
        self.learner.reset()
        self.decisions.zero_()

    @property
    def weights(self) -> Tensor:
        """Action values ``[action, state]``: the long-term memory itself, not a copy."""
        return self.learner.values.weights

    @torch.jit.export
    def learn(self, on: bool = True) -> None:
        """Switch learning on or off."""
        self.learner.values.learn(on)

    @torch.jit.export
    def forget(self) -> None:
        """Erase all that was learned."""
        self.learner.values.forget()

    @torch.jit.unused
    def spread(self, *batch: int) -> "DNSarsa":
        """Resize to ``batch`` and give each agent a copy of the values, to learn on its own."""
        self.learner.values.spread(*batch)
        self.resize(*batch)
        return self

    @torch.jit.unused
    def select(self, index: int) -> "DNSarsa":
        """A new agent without batch, at rest, with the values that one of a batch learned."""
        agent = copy.deepcopy(self)
        agent.learner.values.select(index)
        agent.resize()
        return agent

    def forward(self, observation: Tensor, reward: Tensor, noise: Tensor) -> Tensor:
        output, self.state = self.step(observation, reward, noise, self.state)
        return output

    def step(
        self, observation: Tensor, reward: Tensor, noise: Tensor, state: AgentState
    ) -> tuple[Tensor, AgentState]:
        """One control step of ``dt`` seconds: ``(action, state)``."""
        check_ends("noise", noise, [self.n, self.n])
        before = self.behaviors.satisfaction.output(state.behaviors.satisfaction)
        for _ in range(self.substeps):
            ahead = self.euler(observation, reward, noise, state)
            if self.heun:
                ahead = midpoint(state, self.euler(observation, reward, noise, ahead))
            state = ahead
        intention, after = self.behaviors.output(state.behaviors)
        completed = came_on(before, after).any(-1)
        state = AgentState(
            state.sensorimotor,
            state.behaviors,
            state.value_nodes,
            state.learner,
            state.decisions + completed.to(torch.int64),
        )
        return self.sensorimotor.act(intention, state.sensorimotor), state

    def euler(
        self, observation: Tensor, reward: Tensor, noise: Tensor, state: AgentState
    ) -> AgentState:
        """All parts advance together, from what they were at the beginning of the step."""
        intention, satisfaction = self.behaviors.output(state.behaviors)
        match = self.sensorimotor.match(observation, state.sensorimotor)
        sensorimotor = self.sensorimotor.advance(observation, intention, state.sensorimotor)
        behaviors = self.behaviors.euler(state.value_nodes.value, match, state.behaviors)
        noisy = state.learner.values.weights + noise
        _, value_nodes = self.value_nodes.step(satisfaction, noisy, state.value_nodes)
        _, learner = self.learner.step(intention, satisfaction, reward, state.learner)
        return AgentState(sensorimotor, behaviors, value_nodes, learner, state.decisions)


def midpoint(start: AgentState, end: AgentState) -> AgentState:
    """The state halfway between two: Heun's step is halfway to two Euler steps."""
    fields: dict[str, Tensor] = {}
    for name, value in start.sensorimotor.items():
        fields[name] = halfway(value, end.sensorimotor[name])
    a, b = start.behaviors, end.behaviors
    c, d = start.learner, end.learner
    return AgentState(
        fields,
        BehaviorState(
            NodeState(halfway(a.intention.u, b.intention.u)),
            NodeState(halfway(a.satisfaction.u, b.satisfaction.u)),
        ),
        ValueState(halfway(start.value_nodes.value, end.value_nodes.value)),
        LearnerState(
            TransientState(
                halfway(c.pulses.pulse, d.pulses.pulse),
                halfway(c.pulses.inhibitory, d.pulses.inhibitory),
            ),
            WorkingMemoryState(halfway(c.trace.u, d.trace.u)),
            OppositionState(
                halfway(c.opposition.opposition, d.opposition.opposition),
                halfway(c.opposition.error, d.opposition.error),
            ),
            HebbianState(halfway(c.values.weights, d.values.weights)),
        ),
        start.decisions,
    )
