"""What has to survive from one control step to the next, and over resets."""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torchrl.data import Composite, Unbounded
from torchrl.envs import GymWrapper
from torchrl.envs.transforms import TensorDictPrimer, Transform

from dntorch.experiments import checkpoint


class LastReward(Transform):
    """Shows a policy that learns in its own forward the reward of the step before.

    Collectors hide the reward from the policy, and a reset replaces what the last step of an
    episode brought, its reward included. Here it is stashed, and shown with the first
    observation of the next episode; 0 at the very first.
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
        key: where the state lies in the tensordict.
        state: the state before the first step.
    """

    def __init__(self, key: str, state: TensorDict) -> None:
        leaves = {k: Unbounded(v.shape, v.device, v.dtype) for k, v in state.items()}
        shape = state.batch_size
        super().__init__(Composite({key: Composite(leaves, shape=shape)}, shape=shape))
        self.key, self.begin, self.latest = key, state, state

    def _step(self, tensordict: TensorDictBase, next_tensordict: TensorDictBase) -> TensorDictBase:
        if self.key not in next_tensordict.keys():  # another policy took this step
            next_tensordict.set(self.key, tensordict.get(self.key))
        self.latest = next_tensordict.get(self.key)
        return next_tensordict

    def _reset(
        self, tensordict: TensorDictBase, tensordict_reset: TensorDictBase
    ) -> TensorDictBase:
        return tensordict_reset.set(self.key, self.latest.clone())

    def forget(self) -> None:
        """Begin again, at the next reset, with the state before the first step."""
        self.latest = self.begin


class Resumable(Transform):
    """Puts the world itself into the state of a collector, so that it resumes to the same numbers.

    ``collector.state_dict()`` holds policy and transforms, but no world. With this transform,
    the last one, it also holds a snapshot of the world and what the policy is about to see;
    after ``load_state_dict`` the collector goes on from there.

    The world is an env with ``state_dict()`` and ``load_state_dict(state)``; in a `GymWrapper`
    the wrapped one.
    """

    def __init__(self) -> None:
        super().__init__()
        self.shown: TensorDictBase | None = None
        self.pending: dict[str, Any] | None = None

    @property
    def world(self) -> Any:
        env = self.parent.base_env
        return env._env.unwrapped if isinstance(env, GymWrapper) else env

    def _step(self, tensordict: TensorDictBase, next_tensordict: TensorDictBase) -> TensorDictBase:
        self.shown = next_tensordict
        return next_tensordict

    def _reset(
        self, tensordict: TensorDictBase, tensordict_reset: TensorDictBase
    ) -> TensorDictBase:
        if self.pending is not None:
            self.world.load_state_dict(self.pending["world"])
            tensordict_reset.update(self.pending["shown"])
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
        shown = self.shown.exclude("reward").to_dict()
        return pack({"world": self.world.state_dict(), "shown": shown})

    def set_extra_state(self, state: dict[str, Tensor]) -> None:
        content = unpack(state)
        if not content:
            return
        shown = TensorDict(content["shown"], batch_size=self.parent.batch_size)
        self.pending = {"world": content["world"], "shown": shown}
        collector = self.collector
        if collector is not None:
            collector.reset()  # which shows the policy what is pending


def pack(content: dict[str, Any]) -> dict[str, Tensor]:
    """A checkpoint as bytes: collectors send nothing between processes but dicts of tensors."""
    with TemporaryDirectory() as folder:
        path = Path(folder, "state.pt")
        checkpoint.save(path, content)
        return {"bytes": torch.frombuffer(bytearray(path.read_bytes()), dtype=torch.uint8)}


def unpack(packed: dict[str, Tensor]) -> dict[str, Any]:
    """The content of `pack`, without running any code that it might bring."""
    with TemporaryDirectory() as folder:
        path = Path(folder, "state.pt")
        path.write_bytes(packed["bytes"].numpy().tobytes())
        return checkpoint.load(path)
