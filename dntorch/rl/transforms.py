"""What has to survive from one control step to the next, and over resets."""

import weakref
from typing import Any

import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torchrl.data import Composite, Unbounded
from torchrl.envs import EnvBase, GymWrapper
from torchrl.envs.transforms import TensorDictPrimer, Transform

from dntorch.cells.functions import came_on
from dntorch.rl.state import from_tensors, to_tensors


class LastReward(Transform):
    """Shows a policy that learns in its own forward the reward of the step before.

    Collectors hide the reward from the policy, and a reset replaces what the last step of an
    episode brought, its reward included. Here it is kept until the policy has seen it: with the
    first observation of the next episode, where `AgentPolicy` learns from it before it goes to
    rest, however the episode ended; 0 at the very first. It is the reward that is recorded,
    after all transforms, wherever among them this one stands.
    """

    KEY = "last_reward"

    def __init__(self) -> None:
        super().__init__()
        self.register_buffer("latest", None, persistent=False)

    def _step(self, tensordict: TensorDictBase, next_tensordict: TensorDictBase) -> TensorDictBase:
        self.latest = next_tensordict.get("reward")
        # A copy: a collector that is reset zeroes in place what it was about to show.
        return next_tensordict.set(self.KEY, self.latest.clone())

    def _post_step_mdp_hooks(
        self, tensordict: TensorDictBase, tensordict_: TensorDictBase
    ) -> tuple[TensorDictBase, TensorDictBase]:
        reward = tensordict.get(("next", "reward"))
        if reward is not self.latest:  # a transform behind this one changed it
            self.latest = reward
            tensordict.set(("next", self.KEY), reward)
            tensordict_.set(self.KEY, reward.clone())
        return tensordict, tensordict_

    def _reset(
        self, tensordict: TensorDictBase, tensordict_reset: TensorDictBase
    ) -> TensorDictBase:
        if self.latest is None:
            self.latest = self.parent.full_reward_spec["reward"].zero()
        return tensordict_reset.set(self.KEY, self.latest.clone())

    def transform_observation_spec(self, observation_spec: Composite) -> Composite:
        observation_spec[self.KEY] = self.parent.full_reward_spec["reward"].clone()
        return observation_spec

    def get_extra_state(self) -> dict[str, Tensor]:
        return to_tensors({} if self.latest is None else {"latest": self.latest})

    def set_extra_state(self, state: dict[str, Tensor]) -> None:
        self.latest = from_tensors(state).get("latest")


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
        self.latest = next_tensordict.get(self.KEY).clone()  # which nobody zeroes in place
        return next_tensordict

    def _reset(
        self, tensordict: TensorDictBase, tensordict_reset: TensorDictBase
    ) -> TensorDictBase:
        return tensordict_reset.set(self.KEY, self.latest.clone())

    def forget(self) -> None:
        """Begin again, at the next reset, with the state before the first step."""
        self.latest = self.begin

    def get_extra_state(self) -> dict[str, Tensor]:
        return to_tensors(self.latest.to_dict())

    def set_extra_state(self, state: dict[str, Tensor]) -> None:
        self.latest = TensorDict(
            from_tensors(state), self.begin.batch_size, device=self.begin.device
        )


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
    anywhere among them, it also holds a snapshot of the world and what the policy is about to
    see; after ``load_state_dict`` the collector goes on from there. Without a collector it is
    the snapshot of the world alone.

    The world is an env with ``state_dict()`` and ``load_state_dict(state)``; in a `GymWrapper`
    the wrapped one. One without, a robot, is as it is: there the agent begins at rest with
    what it had learned.
    """

    def __init__(self) -> None:
        super().__init__()
        self._begun, self._registered = False, no_collector

    @property
    def collector(self) -> Any:
        """The collector that steps this env, or None."""
        registered = None if self.container is None else self.container.collector
        return self._registered() if registered is None else registered

    def clone(self) -> "Resumable":
        """What ``max_frames_per_traj`` does after the collector made itself known to the first."""
        twin, collector = super().clone(), self.collector
        twin._registered = no_collector if collector is None else weakref.ref(collector)
        return twin

    def _reset(
        self, tensordict: TensorDictBase, tensordict_reset: TensorDictBase
    ) -> TensorDictBase:
        self._begun = True
        return tensordict_reset

    def get_extra_state(self) -> dict[str, Tensor]:
        if not self._begun:
            return to_tensors({})
        content: dict[str, Any] = {}
        world, collector = world_of(self.parent), self.collector
        if hasattr(world, "state_dict"):
            content["world"] = world.state_dict()
        if collector is not None:
            content["shown"] = collector._carrier.select(*_shown(collector.env)).to_dict()
        return to_tensors(content)

    def set_extra_state(self, state: dict[str, Tensor]) -> None:
        content, collector = from_tensors(state), self.collector
        if not content:
            return
        if collector is not None:
            collector.reset()
        if "world" in content:
            world_of(self.parent).load_state_dict(content["world"])
        if collector is not None and "shown" in content:
            carrier = collector._carrier
            shown = TensorDict(content["shown"], carrier.batch_size, device=carrier.device)
            if "world" not in content:
                shown = shown.select(AgentPrimer.KEY, strict=False)
            carrier.update(shown)


def no_collector() -> None:
    """In place of a reference to a collector."""


def _shown(env: EnvBase) -> list[Any]:
    """What an env shows before a step: after all transforms, those that a collector adds too."""
    return [*env.full_observation_spec.keys(True, True), *env.full_done_spec.keys(True, True)]


def world_of(env: EnvBase) -> Any:
    """The world below all transforms and wrappers."""
    base = env.base_env
    return base._env.unwrapped if isinstance(base, GymWrapper) else base
