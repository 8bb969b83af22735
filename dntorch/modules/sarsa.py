"""The whole agent: DN-SARSA(lambda)."""

from typing import NamedTuple

import torch
from torch import Tensor

from dntorch.cells.functions import came_on, cleaned, differ, finite
from dntorch.cells.integrators import check_integrator
from dntorch.cells.value import ValueState
from dntorch.checks import check_count, check_ends
from dntorch.dynamics import Dynamics, check_parts
from dntorch.memory import counted
from dntorch.modules.behaviors import BehaviorState, ElementaryBehaviors
from dntorch.modules.constraints import Constraints
from dntorch.modules.curiosity import Curiosity
from dntorch.modules.deliberation import Deliberation, DeliberationState, check_states_fit
from dntorch.modules.habituation import Habituation
from dntorch.modules.learner import Learner, LearnerState
from dntorch.modules.recall import Recall
from dntorch.modules.sensorimotor import Direct, Sensorimotor
from dntorch.modules.value import ValueNodes


class AgentState(NamedTuple):
    sensorimotor: dict[str, Tensor]
    behaviors: BehaviorState
    value_nodes: ValueState
    learner: LearnerState
    deliberation: DeliberationState
    decisions: Tensor
    """Number of behaviours that ended in an agent's life, ``(*batch,)``, int64: one decision
    follows each, with noise of its own. It begins at 0 after `forget`, and where `resize` makes
    room for other agents."""
    failures: Tensor
    """How many of them ended without success, ``(*batch,)``, int64"""
    ignored: Tensor
    """Number of steps in which an input was not finite, ``(*batch,)``, int64"""


class DNSarsa(Dynamics[AgentState]):
    r"""An agent that learns a rewarding sequence of behaviours from delayed reward.

    Composes the paper's architecture::

        observation -> sensorimotor -> match -> behaviors -> pairs -> pulses -> trace
                            ^                    |    ^                           |
        action <------------+---- intention -----+    +--- value nodes <- values <+- opposition
                                                                            ^
                                                                          reward

    Every part reads the activation of time t, then all are updated (synchronous Euler with
    ``substeps`` inside a control step, or Heun). Parts that the paper has not go before the value
    nodes (`Deliberation`).

    Args:
        n: number of behaviours.
        sensorimotor: what turns observations into matches and intentions into actions,
            by default `Direct`.
        behaviors, value_nodes, learner: parts with other parameters than the defaults;
            their ``dt`` must be ``dt / substeps``.
        recall: makes a state of more completions than the last.
        habituation: lets noise try what is fresh.
        constraints: learn from failures what does not follow; ``behaviors`` need a
            `Dissatisfaction` for it.
        curiosity: learns what makes a lamp brighter, which the world shows as ``lamp``.
        dt: seconds a control step.
        substeps: integrator steps in a control step, with the same inputs.
        integrator: ``"euler"`` or ``"heun"``.

    Shapes: ``observation`` a dict of tensors with the names in ``senses``, as the sensorimotor
    part wants them; ``reward`` ``(*batch,)``; ``noise`` on the values of actions ``(*batch, n)``
    (see `dntorch.noise.Exploration`; zeros are exploitation); the output is the action.
    State: `AgentState`, at rest but for the long-term memory of values and the three counts, which
    go on over the agent's life: ``reset`` keeps them, ``forget`` makes them 0; they are in a
    snapshot, but in no checkpoint of learned values.

    A NaN or infinity in observation, reward or noise counts as 0 (nothing seen, no reward, no
    noise) and is counted in ``ignored``; one in the match that a sensorimotor part of your own
    makes counts as 0 too. So what was learned is never lost to one bad number.

    ``agent.learn(False)`` stops learning. ``agent.eval()`` does not: an agent learns while it
    lives, and has no layer that behaves otherwise in evaluation.

    Raises:
        ValueError: a part of another size or with another ``dt``; an observation that lacks a
            name.
        TypeError: a sensorimotor part that is no `Sensorimotor`; an observation that is no dict.

    Source: Fig. 1 and section III of Kazerounian, Luciw, Richter and Sandamirskaya,
    "Autonomous Reinforcement of Behavioral Sequences in Neural Dynamics". Deviations: those
    of the parts.

    >>> agent = DNSarsa(2)
    >>> seen = {"match": torch.zeros(2)}  # nothing found yet: the agent starts to want something
    >>> for _ in range(64):
    ...     intention = agent(seen, torch.tensor(0.0), torch.zeros(2))
    >>> int((intention > 0.5).sum())
    1
    """

    __jit_unused_properties__ = ("senses",)
    lasting = ("decisions", "failures", "ignored")
    cleans = True
    decisions: Tensor
    failures: Tensor
    ignored: Tensor

    def __init__(
        self,
        n: int,
        sensorimotor: Sensorimotor | None = None,
        behaviors: ElementaryBehaviors | None = None,
        value_nodes: ValueNodes | None = None,
        learner: Learner | None = None,
        recall: Recall | None = None,
        habituation: Habituation | None = None,
        constraints: Constraints | None = None,
        curiosity: Curiosity | None = None,
        dt: float = 1 / 32,
        substeps: int = 1,
        integrator: str = "euler",
    ) -> None:
        super().__init__(dt)
        check_count("n", n, 2)
        check_integrator(integrator, substeps)
        self.n, self.substeps, self.integrator = n, substeps, integrator
        fine = dt / substeps
        if not isinstance(sensorimotor, Sensorimotor | None):
            raise TypeError(
                f"sensorimotor={sensorimotor} is no Sensorimotor: write it as `Direct` is written"
            )
        self.sensorimotor = sensorimotor or Direct(dt=fine)
        self.behaviors = behaviors or ElementaryBehaviors(n, dt=fine)
        self.value_nodes = value_nodes or ValueNodes(n, dt=fine)
        given = recall, habituation, constraints, curiosity
        self.deliberation = Deliberation(n, *given, dt=fine)
        self.learner = learner or Learner(n, states=self.deliberation.states, dt=fine)
        for name in self.lasting:
            self.register_buffer(name, torch.zeros((), dtype=torch.int64), persistent=False)

    def check(self) -> None:
        check_parts(self, self.n)
        check_states_fit("learner", self.learner.states, self.deliberation.states)
        if self.deliberation.constraints is not None and self.behaviors.dissatisfaction is None:
            raise ValueError(
                "constraints learn from failures, and no intention fails: give behaviors="
                "ElementaryBehaviors(n, dissatisfaction=Dissatisfaction(n))"
            )

    def initial(self, batch: list[int]) -> AgentState:
        return AgentState(
            self.sensorimotor.flat(self.sensorimotor.initial(batch)),
            self.behaviors.initial(batch),
            self.value_nodes.initial(batch),
            self.learner.initial(batch),
            self.deliberation.initial(batch),
            counted(self.decisions, batch),
            counted(self.failures, batch),
            counted(self.ignored, batch),
        )

    @property
    def senses(self) -> tuple[str, ...]:
        """Names in an observation that the agent reads."""
        return tuple(dict.fromkeys((*self.sensorimotor.senses, *self.deliberation.senses)))

    @property
    def weights(self) -> Tensor:
        """Action values ``[action, state]``: the long-term memory itself, not a copy."""
        return self.learner.values.weights

    @torch.jit.export
    def learn(self, on: bool = True) -> None:
        """Switch learning on or off."""
        self.learner.values.learn(on)
        self.deliberation.learn(on)

    def output(self, state: AgentState) -> Tensor:
        """The action."""
        intention, _ = self.behaviors.output(state.behaviors)
        return self.act(intention, state)

    def act(self, intention: Tensor, state: AgentState) -> Tensor:
        """The action for intentions that are known already."""
        inner = self.sensorimotor.nested(state.sensorimotor)
        return self.sensorimotor.limit(self.sensorimotor.act(intention, inner))

    def step(
        self, observation: dict[str, Tensor], reward: Tensor, noise: Tensor, state: AgentState
    ) -> tuple[Tensor, AgentState]:
        """One control step of ``dt`` seconds: ``(action, state)``."""
        check_ends("noise", noise, [self.n])
        check_ends("reward", reward, [])
        batch, dtype = list(state.decisions.shape), state.learner.values.weights.dtype
        reward, noise = reward.to(dtype), noise.to(dtype)
        given = reward, noise
        reward, noise = finite(reward), finite(noise)
        bad = differ(given[0], reward, batch) | differ(given[1], noise, batch)
        seen = self.sensorimotor.sense(observation)
        seen.update(self.deliberation.sense(observation))
        seen, bad = cleaned(seen, dtype, batch, bad)
        start, before = state.behaviors, self.behaviors.output(state.behaviors)
        rates = before
        for _ in range(self.substeps):
            ahead = self.substep(seen, reward, noise, rates, state)
            if self.integrator == "heun":
                rates = self.behaviors.output(ahead.behaviors)
                further = self.substep(seen, reward, noise, rates, ahead)
                ahead = self.halfway(state, further)
            state = ahead
            rates = self.behaviors.output(state.behaviors)
        ended, failures = came_on(before[1], rates[1]).any(-1), state.failures
        if self.behaviors.dissatisfaction is not None:
            failed = self.behaviors.failed(start, state.behaviors)
            ended, failures = ended | failed, failures + failed
        state = AgentState(
            state.sensorimotor,
            state.behaviors,
            state.value_nodes,
            state.learner,
            state.deliberation,
            state.decisions + ended,
            failures,
            state.ignored + bad,
        )
        return self.act(rates[0], state), state

    def substep(
        self,
        observation: dict[str, Tensor],
        reward: Tensor,
        noise: Tensor,
        rates: tuple[Tensor, Tensor],
        state: AgentState,
    ) -> AgentState:
        """All parts advance together, from what they were at the beginning of the step.

        ``rates`` is the output of the behaviours: firing rates of intentions and CoS nodes.
        """
        intention, satisfaction = rates
        weights, pulse = state.learner.values.weights, state.learner.pulses.pulse
        weighed = self.deliberation.weigh(satisfaction, noise, observation, state.deliberation)
        context, tried, available = weighed
        failing = self.behaviors.failing(state.behaviors)
        inner = self.sensorimotor.nested(state.sensorimotor)
        match = finite(self.sensorimotor.match(observation, inner)).clamp(-100.0, 100.0)
        inner = self.sensorimotor.advance(observation, intention, inner)
        return AgentState(
            self.sensorimotor.flat(inner),
            self.behaviors.relax(state.value_nodes.value, match, rates, state.behaviors),
            self.value_nodes.euler(context, weights, tried, available, state.value_nodes),
            self.learner.euler(intention, context, reward, state.learner),
            self.deliberation.euler(
                intention, satisfaction, failing, context, pulse, observation, state.deliberation
            ),
            state.decisions,
            state.failures,
            state.ignored,
        )
