"""A neural field that remembers, under a standard TorchRL actor trained by gradient (PPO).

A light flashes on the left or on the right and is gone; half a second later the agent has to
point to where it was. The actor is a plain linear layer without memory: all it gets is what a
dynamic neural field still holds. Gradients of PPO flow back through every `step` of the field
to what feeds it. At first the flash is too faint to leave a peak and the agent guesses; it
learns to see the flash so strongly that a self-sustained peak keeps it, and to read that peak.
You see both numbers rise: the share of right answers and the peak that is left in the dark.
Not in the paper, whose agent learns without gradients. Ten seconds on one core.

    python recipes/field_actor.py --rounds 20
"""

import argparse

import torch
from tensordict import TensorDict
from tensordict.nn import TensorDictModule, TensorDictSequential
from torch import Tensor, nn
from torchrl.collectors import Collector
from torchrl.data import Bounded, Categorical, Composite, Unbounded
from torchrl.envs import EnvBase
from torchrl.modules import ProbabilisticActor, ValueOperator
from torchrl.objectives import ClipPPOLoss

from dntorch import DNF, Gauss, Global
from dntorch.process import settle

SITES, LIT, DARK = 31, 10, 16  # field sites; control steps of 1/32 s


class Flash(EnvBase):
    """One flash, one answer: a batch of trials that end after one step."""

    def __init__(self, trials: int) -> None:
        super().__init__(batch_size=[trials])
        self.observation_spec = Composite(
            retina=Bounded(0, 1, (trials, SITES), dtype=torch.float32), shape=[trials]
        )
        self.action_spec = Categorical(2, shape=[trials])
        self.reward_spec = Unbounded((trials, 1))

    def _reset(self, tensordict=None, **_) -> TensorDict:
        self.right = torch.rand(self.batch_size) < 0.5
        center = torch.where(self.right, 23.0, 7.0) + torch.randn(self.batch_size)
        site = torch.arange(SITES)
        retina = torch.exp(-0.5 * ((site - center.unsqueeze(-1)) / 2) ** 2)
        return TensorDict({"retina": retina}, self.batch_size)

    def _step(self, tensordict: TensorDict) -> TensorDict:
        correct = tensordict["action"] == self.right.long()
        over = torch.ones((*self.batch_size, 1), dtype=torch.bool)
        return TensorDict(
            {"retina": torch.zeros(*self.batch_size, SITES), "reward": correct.float()[:, None],
             "done": over, "terminated": over.clone()},
            self.batch_size,
        )  # fmt: skip

    def _set_seed(self, seed: int | None) -> None:
        torch.manual_seed(seed or 0)


class Eye(nn.Module):
    """What a field holds in the dark after a flash; differentiable to its input's gain."""

    def __init__(self) -> None:
        super().__init__()
        self.gain = nn.Parameter(torch.tensor(1.0))
        self.field = DNF(SITES, (Gauss(8.0, 2.0), Global(-0.3)), h=-2.0, steepness=2.0)

    def forward(self, retina: Tensor) -> Tensor:
        state = self.field.initial(list(retina.shape[:-1]))
        output = retina
        for step in range(LIT + DARK):
            output, state = self.field.step(self.gain * retina * (step < LIT), state)
        return output


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=20)
    parser.add_argument("--trials", type=int, default=128, help="in a round")
    arguments = parser.parse_args()
    torch.manual_seed(0)
    settle()

    eye = Eye()
    head = nn.Linear(SITES, 2)
    nn.init.zeros_(head.weight)
    env = Flash(arguments.trials)
    actor = ProbabilisticActor(
        TensorDictSequential(
            TensorDictModule(eye, ["retina"], ["held"]),
            TensorDictModule(head, ["held"], ["logits"]),
        ),
        in_keys=["logits"], spec=env.action_spec, return_log_prob=True,
        distribution_class=torch.distributions.Categorical,
    )  # fmt: skip
    critic = ValueOperator(nn.Linear(SITES, 1), in_keys=["retina"])
    loss = ClipPPOLoss(actor, critic, entropy_coeff=0.0, normalize_advantage=True)
    optimizer = torch.optim.Adam(
        [{"params": [eye.gain], "lr": 0.1}, {"params": head.parameters(), "lr": 0.1},
         {"params": critic.parameters(), "lr": 0.03}]
    )  # fmt: skip
    frames = arguments.trials
    collector = Collector(
        env, actor, frames_per_batch=frames, total_frames=frames * arguments.rounds,
        auto_register_policy_transforms=False,
    )  # fmt: skip
    for k, batch in enumerate(collector):
        right = batch["next", "reward"].mean()
        peak = batch["held"].amax(-1).mean()
        if k % 2 == 0 or k == arguments.rounds - 1:
            print(f"round {k}: {right:.0%} right, peak in the dark {peak:.2f}, "
                  f"gain {eye.gain.item():.2f}", flush=True)  # fmt: skip
        with torch.no_grad():
            loss.value_estimator(batch, params=loss.critic_network_params,
                                 target_params=loss.target_critic_network_params)  # fmt: skip
        for _ in range(4):
            losses = loss(batch.reshape(-1))
            optimizer.zero_grad()
            (losses["loss_objective"] + losses["loss_critic"]).backward()
            optimizer.step()


if __name__ == "__main__":
    main()
