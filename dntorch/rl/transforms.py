"""What has to survive from one control step to the next, and over resets."""

from typing import Any

import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torchrl.data import Composite, Unbounded
from torchrl.envs import EnvBase, GymWrapper
from torchrl.envs.transforms import TensorDictPrimer, Transform

from dntorch.cells.functions import came_on
from dntorch.rl.state import pack, unpack


class LastReward(Transform):
    """Shows a policy that learns in its own forward the reward of the step before.

    Collectors hide the reward from the policy, and a reset replaces what the last step of an
    episode brought, its reward included. Here it is stashed, and shown with the first
    observation of the next episode, where `AgentPolicy` learns from it before it goes to rest;
    0 at the very first.
    """

    KEY = "last_reward"

    def __init__(self) -> None:
        super().__init__()
        self.register_buffer("terminal", None, persistent=False)

    def _step(self, tensordict: TensorDictBase, next_tensordict: TensorDictBase) -> TensorDictBase:
        reward = next_tensordict.get("reward")
        self.terminal = torch.where(next_tensordict.get("done"), reward, 0)
        return next_tensordict.set(self.KEY, reward)

    def _reset(
        self, tensordict: TensorDictBase, tensordict_reset: TensorDictBase
    ) -> TensorDictBase:
        last = self.parent.full_reward_spec["reward"].zero()
        return tensordict_reset.set(self.KEY, last if self.terminal is None else self.terminal)

    def transform_observation_spec(self, observation_spec: Composite) -> Composite:
        observation_spec[self.KEY] = self.parent.full_reward_spec["reward"].clone()
        return observation_spec


class AgentPrimer(TensorDictPrimer):
    """Carries an agent's state from step to step, *and over resets*: what was learned stays.

    (TorchRL's own primer starts anew at each reset. The policy itself puts the activation to
    rest when it sees ``is_init``.)

    Args:
        state: the state before the first step; it lies in the tensordict under ``agent``.
    """

    KEY = "agent"

    def __init__(self, state: TensorDict) -> None:
        leaves = {k: Unbounded(v.shape, v.device, v.dtype) for k, v in state.items()}
        shape = state.batch_size
        super().__init__(Composite({self.KEY: Composite(leaves, shape=shape)}, shape=shape))
        self.begin, self.latest = state, state

    def _step(self, tensordict: TensorDictBase, next_tensordict: TensorDictBase) -> TensorDictBase:
        if self.KEY not in next_tensordict.keys():  # another policy took this step
            next_tensordict.set(self.KEY, tensordict.get(self.KEY))
        self.latest = next_tensordict.get(self.KEY)
        return next_tensordict

    def _reset(
        self, tensordict: TensorDictBase, tensordict_reset: TensorDictBase
    ) -> TensorDictBase:
        return tensordict_reset.set(self.KEY, self.latest.clone())

    def forget(self) -> None:
        """Begin again, at the next reset, with the state before the first step."""
        self.latest = self.begin


class Report(Transform):
    """Tells a world that cannot see for itself what the agent says it has found.

    A condition of satisfaction that comes on is passed to the world's ``report(position)``
    before the step, as a `HardwareEnv` wants it. A policy that writes no ``satisfaction``
    reports nothing.
    """

    def __init__(self) -> None:
        super().__init__()
        self.satisfaction: Tensor | None = None

    def _inv_call(self, tensordict: TensorDictBase) -> TensorDictBase:
        satisfaction = tensordict.get("satisfaction", None)
        if satisfaction is not None:
            none = torch.zeros_like(satisfaction)
            before = none if self.satisfaction is None else self.satisfaction
            self.satisfaction = satisfaction.clone()
            new = came_on(before, satisfaction)
            if new.any():
                world_of(self.parent).report(int(new.nonzero()[0]))
        return tensordict


class Resumable(Transform):
    """Puts the world itself into the state of a collector, so that it resumes to the same numbers.

    ``collector.state_dict()`` holds policy and transforms, but no world. With this transform,
    the last one, it also holds a snapshot of the world and what the policy is about to see;
    after ``load_state_dict`` the collector goes on from there. (So TorchRL's ``StepCounter``
    goes in front: ``env.insert_transform(0, StepCounter(...))``.)

    The world is an env with ``state_dict()`` and ``load_state_dict(state)``; in a `GymWrapper`
    the wrapped one. One without, a robot, is as it is: there the agent begins at rest with
    what it had learned.
    """

    def __init__(self) -> None:
        super().__init__()
        self.shown: TensorDictBase | None = None
        self.pending: dict[str, Any] | None = None

    def _step(self, tensordict: TensorDictBase, next_tensordict: TensorDictBase) -> TensorDictBase:
        self.shown = next_tensordict
        return next_tensordict

    def _reset(
        self, tensordict: TensorDictBase, tensordict_reset: TensorDictBase
    ) -> TensorDictBase:
        if self.pending is not None:
            shown = self.pending["shown"]
            if self.pending["world"] is None:
                shown = shown.select(AgentPrimer.KEY, strict=False)
            else:
                world_of(self.parent).load_state_dict(self.pending["world"])
            tensordict_reset.update(shown)
            self.pending = None
        mask = tensordict.get("_reset", None)
        if mask is None or mask.all() or self.shown is None:
            self.shown = tensordict_reset.copy()
        else:
            kept = self.shown.select(*tensordict_reset.keys(True, True))
            self.shown = tensordict_reset.where(mask.squeeze(-1), kept)
        return tensordict_reset

    def get_extra_state(self) -> dict[str, Tensor]:
        if self.shown is None:
            return pack({})
        save = getattr(world_of(self.parent), "state_dict", lambda: None)
        return pack({"world": save(), "shown": self.shown.exclude("reward").to_dict()})

    def set_extra_state(self, state: dict[str, Tensor]) -> None:
        content = unpack(state)
        if not content:
            return
        shown = TensorDict(content["shown"], batch_size=self.parent.batch_size)
        self.pending = {"world": content["world"], "shown": shown}
        collector = self.collector
        if collector is not None:
            collector.reset()  # which shows the policy what is pending


def world_of(env: EnvBase) -> Any:
    """The world below all transforms and wrappers."""
    base = env.base_env
    return base._env.unwrapped if isinstance(base, GymWrapper) else base
