"""A policy for TorchRL made from the agent; it learns on line in its own forward."""

from contextlib import nullcontext
from typing import Any

import torch
from tensordict import TensorDict, TensorDictBase
from tensordict.nn import TensorDictModuleBase
from torch import Tensor
from torch.utils import _pytree as pytree

from dntorch.cells.functions import finite
from dntorch.modules.sarsa import AgentState, DNSarsa
from dntorch.noise import Exploration
from dntorch.rl.buffers import StateBuffers
from dntorch.rl.form import check_agent, check_form, check_noise, spec_of, written
from dntorch.rl.state import from_tensors, to_tensors
from dntorch.rl.transforms import AgentPrimer


class AgentPolicy(TensorDictModuleBase):
    """Reads what the world shows and rewards, writes what the agent does and has in mind.

    ============  =======================  ===================================================
    key           shape                    meaning
    ============  =======================  ===================================================
    *reads*
    agent.senses  as the agent wants them  each name a key: ``image``, ``proximity``, ``match``
    last_reward   ``(*batch, 1)``          of the step before, see `LastReward`
    is_init       ``(*batch, 1)``          activation goes back to rest, what was learned stays
    *writes*
    action        as the agent has it
    intention     ``(*batch, n)``          firing rate of the intention nodes
    satisfaction  ``(*batch, n)``          firing rate of the CoS nodes
    trace         ``(*batch, n, states)``  eligibility ``[action, state]``
    error         ``(*batch,)``            value cell
    weights       ``(*batch, n, states)``  learned values ``[action, state]``
    steps         ``(*batch,)``            control steps taken so far, int64
    ============  =======================  ===================================================

    The state (activations, learned values, number of steps) lies in one of two places:

    * in buffers (the default): ``policy.agent`` itself learns. For one process, and for
      processes that each build a policy of their own (``policy_factory=``).
    * in the tensordict (``carried=True``), under ``agent``, beside the seed of exploration:
      ``policy.agent`` stays as it is. For collectors that share or send policies. The env
      needs ``policy.primer()``; ``policy.adopt(batch)`` gives the agent what was learned.

    ``policy.agent = other``, or a part of it replaced, acts and learns from the next step on, if it
    has the same senses and shapes. With the state in the tensordict it is refused: there the
    values of the other would not count.

    Args:
        agent: a `DNSarsa`, with a batch if the env has one (then with values of its own for
            each: call ``agent.spread(*batch)``).
        explore: steps with noise on the values; then they are exploited.
        exploration: the noise; without it there is none.
        carried: keep the state in the tensordict.

    Raises:
        TypeError: an agent that is no `DNSarsa`.
        ValueError: ``explore`` that is no number of steps, or without ``exploration``; values that
            a batch would share; an agent that no longer fits.
        RuntimeError: on a step, when buffers that hold state lie in shared memory.
        KeyError: on a step, when the tensordict lacks a key.
    """

    def __init__(
        self,
        agent: DNSarsa,
        explore: int = 0,
        exploration: Exploration | None = None,
        carried: bool = False,
    ) -> None:
        super().__init__()
        self.explore, self.exploration, self.carried = explore, exploration, carried
        self._require_noise()
        self.agent = agent
        batch = list(agent.origin.shape)
        self.register_buffer("steps", torch.zeros(batch, dtype=torch.int64), persistent=False)
        self.buffers = StateBuffers(self)
        self.in_keys = [*agent.senses, "last_reward", "is_init"]
        self.spec = spec_of(agent)
        self.out_keys = list(self.spec.keys())
        if carried:
            kept = [(AgentPrimer.KEY, k) for k in [*self.buffers.names, "steps", "seed"]]
            self.in_keys += kept
            self.out_keys += [("next", key) for key in kept]

    # ------------------------------------------------------------- what may be set

    def __setattr__(self, name: str, value: Any) -> None:
        if name == "agent":
            check_agent(value)
            if "agent" in self._modules:
                self.require_form(value, replaced=True)
        super().__setattr__(name, value)

    def require_form(self, agent: DNSarsa, replaced: bool = False) -> None:
        """Raise unless an agent can act and learn in this policy."""
        if replaced and self.carried:
            raise RuntimeError(
                "agent or a part of it was replaced, but what it learned lies in the tensordict: "
                "build another AgentPolicy and its primer()"
            )
        check_form(agent, self.in_keys[: self.in_keys.index("last_reward")], self.spec)

    def _require_noise(self) -> None:
        check_noise(self.explore, self.exploration)

    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        state, steps, seed = self._recall(tensordict)
        observation = {name: self._shown(tensordict, name) for name in self.agent.senses}
        first = self._shown(tensordict, "is_init").squeeze(-1)
        reward = self._shown(tensordict, "last_reward").squeeze(-1)
        if first.any():
            state = self._begin(first, reward, state)
        noise = self._noise(state.decisions, steps, seed)
        # Faster, where no gradient is wanted; but TorchRL writes in place to what it carries.
        plain = self.carried or torch.is_grad_enabled()
        with nullcontext() if plain else torch.inference_mode():
            action, state = self.agent.step(observation, reward, noise, state)
        steps = steps + 1
        self._remember(tensordict, state, steps, seed)
        content = written(self.agent, state, steps) | {"action": action}
        for key, value in content.items():  # a new tensor each step, never a buffer
            tensordict.set(key, value.clone() if value.is_inference() else value)
        return tensordict

    def _shown(self, tensordict: TensorDictBase, key: str) -> Tensor:
        value = tensordict.get(key, None)
        if value is None:
            shown = sorted(str(name) for name in tensordict.keys())
            remedy = "make the env with wrap or transformed of dntorch.rl"
            if key in self.agent.senses:
                remedy = (
                    "the agent reads it, so build the env with senses=agent.senses, or append "
                    f"RenameTransform([name], [{key!r}]) to it"
                )
            raise KeyError(f"the tensordict lacks {key!r}: {remedy}; it has {shown}")
        return value

    def _noise(self, decisions: Tensor, steps: Tensor, seed: Tensor | None = None) -> Tensor:
        exploring, draws = steps < self.explore, self.exploration
        if not exploring.any():
            return torch.zeros_like(self.agent.weights[..., 0])
        self._require_noise()
        if seed is not None and not (seed == draws.seed).all():
            draws.seed = seed.clone()
        noise = draws(decisions, self.agent.weights.dtype)
        if exploring.all():
            return noise
        return noise * exploring.unsqueeze(-1).to(noise)

    def _begin(self, first: Tensor, reward: Tensor, state: AgentState) -> AgentState:
        """At rest where ``first``; values and counts go on.

        Before it rests it learns from the terminal reward: only the old trace knows what
        earned it.
        """
        learner, running = self.agent.learner, state.learner
        intention, satisfaction = self.agent.behaviors.output(state.behaviors)
        context = self.agent.deliberation.context(satisfaction, state.deliberation)
        active = learner.active(intention, context)
        none = torch.zeros_like(running.opposition.error)
        trace, reward = running.trace.u, finite(reward.to(running.values.weights.dtype))
        values = learner.values.euler(active, trace, none, reward, running.values)

        def pick(rest: Tensor, running: Tensor) -> Tensor:
            mask = first.reshape(first.shape + (1,) * (running.dim() - first.dim()))
            return torch.where(mask, rest, running)

        values = pytree.tree_map(pick, values, running.values)
        now = self.agent.flat(state._replace(learner=running._replace(values=values)))
        begun = pytree.tree_map(pick, self.agent.initial(list(first.shape)), state)
        lasting = self.agent.state_dict().keys() & now.keys() | set(self.agent.lasting)
        kept = {name: now[name] for name in lasting}
        return self.agent.nested(self.agent.flat(begun) | kept)

    # ------------------------------------------------------------- where the state is kept

    def _recall(self, tensordict: TensorDictBase) -> tuple[AgentState, Tensor, Tensor | None]:
        if not self.carried:
            self._refuse_shared_memory()
            return self.buffers.read(), self.steps, None
        kept = tensordict.get(AgentPrimer.KEY, None)
        content = {} if kept is None else dict(kept.items())
        missing = [k for k in [*self.buffers.names, "steps", "seed"] if k not in content]
        if missing:
            raise KeyError(
                f"the tensordict lacks {missing[0]!r} under {AgentPrimer.KEY!r}: without its state "
                "the agent would forget in silence; append policy.primer() to the env's transforms"
            )
        return self.agent.nested(content), content["steps"], content["seed"]

    def _remember(
        self, tensordict: TensorDictBase, state: AgentState, steps: Tensor, seed: Tensor | None
    ) -> None:
        if self.carried:
            tensordict.set(("next", AgentPrimer.KEY), self._pack(state, steps, seed))
        else:
            self.buffers.write(state)
            self.steps.copy_(steps)

    def _pack(self, state: AgentState, steps: Tensor, seed: Tensor) -> TensorDict:
        content = self.agent.flat(state) | {"steps": steps, "seed": seed}
        return TensorDict(content, batch_size=self.steps.shape)

    def _refuse_shared_memory(self) -> None:
        buffer = self.agent.decisions
        if not buffer.is_cuda and buffer.is_shared():  # all memory of a GPU can be shared
            raise RuntimeError(
                "the buffers of this policy lie in memory that several processes share: they "
                "would all step one agent. Pass policy_factory=, a function that builds a policy "
                "in each process, instead of policy=; or build it with carried=True"
            )

    def primer(self, seed: int | Tensor | None = None) -> AgentPrimer:
        """The transform that carries an agent's state, from what ``policy.agent`` is now.

        ``seed`` is that of its exploration, so that one policy serves several agents; by
        default that of the policy.
        """
        if seed is None:
            seed = self.exploration.seed if self.exploration else 0
        seeds = torch.zeros_like(self.steps) + torch.as_tensor(seed)
        return AgentPrimer(self._pack(self.agent.state, self.steps.clone(), seeds))

    def adopt(self, batch: TensorDictBase) -> DNSarsa:
        """Give the agent the state after the last step of a ``batch`` that carries it."""
        last = batch[..., -1].get(("next", AgentPrimer.KEY))
        self.agent.state = self.agent.nested(dict(last.items()))
        self.steps.copy_(last.get("steps"))
        return self.agent

    # ------------------------------------------------------------- checkpoints

    def get_extra_state(self) -> dict[str, Tensor]:
        """All that an exact resume needs; the rest of ``state_dict`` is what was learned."""
        return to_tensors({"agent": self.agent.snapshot(), "steps": self.steps})

    def set_extra_state(self, state: dict[str, Tensor]) -> None:
        content = from_tensors(state)
        self.agent.restore(content["agent"])
        self.steps.copy_(content["steps"])
