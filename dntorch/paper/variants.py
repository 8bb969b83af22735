"""Agents with one thing changed: controls, and the equations as they were printed.

Each function takes the working agent and changes it in place. A control removes what the
paper says is needed; a misprint puts one printed number or formula back (docs/deviations.md
says what the library uses instead, and why).
"""

from collections.abc import Callable

import torch
from torch import Tensor

from dntorch.cells.value import ValueState
from dntorch.dynamics import Dynamics
from dntorch.modules.learner import Learner, LearnerState
from dntorch.modules.node import NodeState, NodeWTA
from dntorch.modules.sarsa import DNSarsa
from dntorch.modules.value import ValueNodes
from dntorch.number import wide
from dntorch.runs.build import build_agent
from dntorch.runs.config import Config


class SingleItem(Learner):
    """TD(0): only the pair that was completed last is eligible, all older ones are forgotten."""

    def euler(
        self, intention: Tensor, satisfaction: Tensor, reward: Tensor, state: LearnerState
    ) -> LearnerState:
        active = self.active(intention, satisfaction)
        waiting = state.trace.u * (1 - active)
        newest = waiting == waiting.amax((-2, -1), keepdim=True)
        values = self.values.euler(
            active, waiting * newest, state.opposition.error, reward, state.values
        )
        return super().euler(intention, satisfaction, reward, state)._replace(values=values)


class NoOffset(Learner):
    """No pulse at the offset of a pair: the value of the old pair is never subtracted."""

    def euler(
        self, intention: Tensor, satisfaction: Tensor, reward: Tensor, state: LearnerState
    ) -> LearnerState:
        onset = state.pulses.pulse.clamp_min(0)
        opposition = self.opposition.euler(
            onset, state.trace.u, state.values.weights, state.opposition
        )
        after = super().euler(intention, satisfaction, reward, state)
        return after._replace(opposition=opposition)


class PrintedSigmoid(NodeWTA):
    """Nodes with the sigmoid as printed: 1/2 above the threshold, to -1/2 below it."""

    def output(self, state: NodeState) -> Tensor:
        x = self.steepness * (state.u - self.threshold)
        return (1 + x) / (2 * (1 + x.abs()))


class PrintedValueNodes(ValueNodes):
    """Value nodes as printed: integrators without a leak, which are normalised afterwards."""

    def euler(
        self,
        context: Tensor,
        weights: Tensor,
        noise: Tensor,
        available: Tensor,
        state: ValueState,
    ) -> ValueState:
        others = weights * (1 - torch.eye(self.n))
        input = torch.matmul(others, context.unsqueeze(-1)).squeeze(-1) + noise
        value = state.value + self.dt / wide(self.tau, 1) * input
        return ValueState(value / value.sum(-1, keepdim=True))


def _become(part: Dynamics, kind: type[Dynamics]) -> None:
    part.__class__ = kind  # same structure and parameters, another step


def _unchecked(part: Dynamics) -> None:
    """Let a part take any number, also one that its ``check`` refuses since it does not work."""
    kind = type(part)
    _become(part, type(f"Unchecked{kind.__name__}", (kind,), {"check": lambda self: None}))


def _printed_pairs(agent: DNSarsa) -> None:
    # f_S > 0 everywhere, so the printed Heaviside is one for every pair at every time.
    _unchecked(agent.learner)
    agent.learner.coincidence_threshold = -1.0


def _pulse_threshold(agent: DNSarsa) -> None:
    _unchecked(agent.learner.opposition)
    agent.learner.opposition.pulse_threshold = 0.0


def _rest(agent: DNSarsa) -> None:
    _unchecked(agent.behaviors.intention)
    _unchecked(agent.behaviors.satisfaction)
    agent.behaviors.intention.h = agent.behaviors.satisfaction.h = 5.0


def _no_memory(agent: DNSarsa) -> None:
    agent.behaviors.satisfaction.excitation = 4.0  # below -h: dies with its input
    agent.behaviors.satisfaction.inhibition = 0.0


def _no_rivalry(agent: DNSarsa) -> None:
    agent.behaviors.satisfaction.inhibition = 0.0


def _value_nodes(agent: DNSarsa) -> None:
    _become(agent.value_nodes, PrintedValueNodes)
    agent.behaviors.value_gain = 20.0  # of shares that sum to one
    agent.behaviors.completion_gain = 40.0


def _short_trace(agent: DNSarsa) -> None:
    agent.learner.trace.tau = 0.1


def _sigmoid(agent: DNSarsa) -> None:
    _become(agent.behaviors.intention, PrintedSigmoid)
    _become(agent.behaviors.satisfaction, PrintedSigmoid)


#: What is changed, by name; the empty name changes nothing.
VARIANTS: dict[str, Callable[[DNSarsa], None]] = {
    "": lambda agent: None,
    "single_item": lambda agent: _become(agent.learner, SingleItem),
    "short_trace": _short_trace,
    "no_offset": lambda agent: _become(agent.learner, NoOffset),
    "printed_rest": _rest,
    "printed_sigmoid": _sigmoid,
    "printed_value_nodes": _value_nodes,
    "printed_pairs": _printed_pairs,
    "printed_pulse_threshold": _pulse_threshold,
    "printed_intention_inhibition": lambda agent: setattr(
        agent.behaviors.intention, "inhibition", 10.0
    ),
    "printed_completion_gain": lambda agent: setattr(agent.behaviors, "completion_gain", 5.0),
    "printed_cos_no_memory": _no_memory,
    "printed_cos_no_rivalry": _no_rivalry,
}


def build_variant(config: Config, variant: str = "") -> DNSarsa:
    """The agent of ``config`` with one thing changed."""
    if variant not in VARIANTS:
        raise ValueError(f"variant={variant!r} is unknown: choose from {', '.join(VARIANTS)}")
    agent = build_agent(config)
    VARIANTS[variant](agent)
    agent.reset()  # another resting level is another state at rest
    return agent
