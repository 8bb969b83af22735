"""What a policy writes, and what an agent must be to act in it."""

import math

from torch import Tensor
from torchrl.data import Composite, Unbounded

from dntorch.modules.sarsa import AgentState, DNSarsa
from dntorch.noise import Exploration
from dntorch.quantities import Interval, check_kind, shown

STEPS = Interval(0, math.inf)


def written(agent: DNSarsa, state: AgentState, steps: Tensor) -> dict[str, Tensor]:
    """What an agent has in mind, by name."""
    intention, satisfaction = agent.behaviors.output(state.behaviors)
    learner = state.learner
    return {
        "intention": intention,
        "satisfaction": satisfaction,
        "trace": learner.trace.u,
        "error": learner.opposition.error,
        "weights": learner.values.weights,
        "steps": steps,
    }


def spec_of(agent: DNSarsa) -> Composite:
    """All that a policy with this agent writes."""
    batch = list(agent.origin.shape)
    state = agent.initial(batch)
    content = written(agent, state, agent.decisions) | {"action": agent.output(state)}
    return Composite(
        {k: Unbounded(v.shape, v.device, v.dtype) for k, v in content.items()}, shape=batch
    )


def check_agent(agent: DNSarsa) -> None:
    """Raise unless each member of a batch learns its own values."""
    if not isinstance(agent, DNSarsa):
        raise TypeError(f"agent is a {type(agent).__name__}: give a DNSarsa")
    batch, own = list(agent.origin.shape), list(agent.weights.shape[:-2])
    if own != batch:
        raise ValueError(
            f"an agent of batch {batch} with weights of batch {own}: call agent.spread(*batch) to "
            "let each learn its own"
        )


def check_form(agent: DNSarsa, senses: list[str], spec: Composite) -> None:
    """Raise unless an agent has the senses and the shapes that a policy was built with."""
    check_agent(agent)
    now = spec_of(agent)
    pairs = {name: (list(now[name].shape), list(spec[name].shape)) for name in now.keys()}
    for name, (own, built) in {"senses": (list(agent.senses), senses), **pairs}.items():
        if own != built:
            raise ValueError(
                f"{name} of the agent is {own}, the policy was built for {built}: build another "
                "AgentPolicy"
            )


def check_noise(explore: float, exploration: Exploration | None) -> None:
    """Raise unless a policy can explore for so many steps."""
    if explore not in STEPS:
        raise ValueError(f"explore={shown(explore)}: give a number of steps, 0 or more")
    if exploration is not None:
        check_kind("exploration", exploration, Exploration)
    elif explore:
        raise ValueError(f"explore={explore} needs exploration=dntorch.Exploration(n, seed)")
