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
from dntorch.experiments.config import Config, build_agent
from dntorch.modules.learner import Learner, LearnerState
from dntorch.modules.node import NodeState, NodeWTA
from dntorch.modules.sarsa import DNSarsa
from dntorch.modules.value import ValueNodes


class SingleItem(Learner):
    """TD(0): only the pair that was completed last is eligible, all older ones are forgotten."""

    def step(
        self, intention: Tensor, satisfaction: Tensor, reward: Tensor, state: LearnerState
    ) -> tuple[Tensor, LearnerState]:
        active = self.active(intention, satisfaction)
        waiting = state.trace.u * (1 - active)
        newest = waiting == waiting.amax((-2, -1), keepdim=True)
        _, values = self.values.step(
            active, waiting * newest, state.opposition.error, reward, state.values
        )
        _, after = super().step(intention, satisfaction, reward, state)
        return values.weights, LearnerState(after.pulses, after.trace, after.opposition, values)


class NoOffset(Learner):
    """No pulse at the offset of a pair: the value of the old pair is never subtracted."""

    def step(
        self, intention: Tensor, satisfaction: Tensor, reward: Tensor, state: LearnerState
    ) -> tuple[Tensor, LearnerState]:
        _, after = super().step(intention, satisfaction, reward, state)
        onset = state.pulses.pulse.clamp_min(0)
        _, opposition = self.opposition.step(
            onset, state.trace.u, state.values.weights, state.opposition
        )
        after = LearnerState(after.pulses, after.trace, opposition, after.values)
        return after.values.weights, after


class PrintedSigmoid(NodeWTA):
    """Nodes with the sigmoid as printed: 1/2 above the threshold, to -1/2 below it."""

    def output(self, state: NodeState) -> Tensor:
        x = self.steepness * (state.u - self.threshold)
        return (1 + x) / (2 * (1 + x.abs()))

    def euler(self, input: Tensor, state: NodeState) -> NodeState:
        output = self.output(state)
        others = output.sum(-1, keepdim=True) - output
        drive = self.h + self.excitation * output - self.inhibition * others + input
        return NodeState(state.u + self.dt / self.tau * (drive - state.u))


class PrintedValueNodes(ValueNodes):
    """Value nodes as printed: integrators without a leak, which are normalised afterwards."""

    def step(
        self, satisfaction: Tensor, weights: Tensor, state: ValueState
    ) -> tuple[Tensor, ValueState]:
        input = torch.matmul(weights * self.off_diagonal, satisfaction.unsqueeze(-1)).squeeze(-1)
        value = state.value + self.dt / self.tau * input
        return value, ValueState(value / value.sum(-1, keepdim=True))


def _printed_pairs(agent: DNSarsa) -> None:
    # f_S > 0 everywhere, so the printed Heaviside is one for every pair at every time.
    agent.learner.coincidence_threshold = -1.0


def _rest(agent: DNSarsa) -> None:
    agent.behaviors.intention.h = agent.behaviors.satisfaction.h = 5.0


def _no_memory(agent: DNSarsa) -> None:
    agent.behaviors.satisfaction.excitation = 4.0  # below -h: dies with its input
    agent.behaviors.satisfaction.inhibition = 0.0


def _no_rivalry(agent: DNSarsa) -> None:
    agent.behaviors.satisfaction.inhibition = 0.0


def _short_trace(agent: DNSarsa) -> None:
    agent.learner.trace.tau = 0.1


def _become(part: Dynamics, kind: type) -> None:
    part.__class__ = kind  # same structure and parameters, another step


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
    "printed_value_nodes": lambda agent: _become(agent.value_nodes, PrintedValueNodes),
    "printed_pairs": _printed_pairs,
    "printed_pulse_threshold": lambda agent: setattr(
        agent.learner.opposition, "pulse_threshold", 0.0
    ),
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
    return agent
