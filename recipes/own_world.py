"""The learner in another body: a cart on a rail that finds out in which order to call at stations.

Nothing here sees colours or turns on the spot. The world is a small Gymnasium environment of
its own: a cart, four stations on a rail, and a reward for well, mill, oven, well in this order.
The body is a `Sensorimotor` with three methods (`match`, `advance`, `act`): a dynamic neural
field says where the cart is, a station is reached when the field's peak lies on it, and an
intention pulls the cart to its station. The rest, behaviours, memory and values, is the paper's
agent unchanged, run by a TorchRL collector.

You see calls and rewards in every 2,000 steps, few and by chance while it explores, nearly
every third call after that, and the learned values. About half a minute on one core.

    python recipes/own_world.py --explore 16000 --exploit 8000
"""

import argparse
from typing import NamedTuple

import gymnasium
import numpy as np
import torch
from torch import Tensor
from torchrl.collectors import Collector
from torchrl.data import Unbounded

from dntorch import DNF, DNSarsa, Exploration, Gauss, Global, Sensorimotor
from dntorch.cells.field import FieldState
from dntorch.process import settle
from dntorch.rl import AgentPolicy, wrap

STATIONS = {"well": -0.75, "mill": -0.25, "oven": 0.25, "shed": 0.75}  # m, on the rail
ORDER = ["well", "mill", "oven", "well"]
DT = 1 / 32  # s, a control step


class Rail(gymnasium.Env):
    """Observation: position in m. Action: speed in m/s. A call: 0.6 s at a station."""

    observation_space = gymnasium.spaces.Dict(
        {"position": gymnasium.spaces.Box(-1, 1, (1,), np.float32)}
    )
    action_space = gymnasium.spaces.Box(-2, 2, (1,), np.float32)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.position, self.here, self.bonus, self.calls = 0.0, 0, 0, []
        return self._seen(), {"called": np.int64(-1)}

    def step(self, action):
        self.position = float(np.clip(self.position + DT * action[0], -1, 1))
        distance = [abs(self.position - place) for place in STATIONS.values()]
        at = int(np.argmin(distance)) if min(distance) < 0.05 else -1
        last = self.calls[-1] if self.calls else -1
        self.here = self.here + 1 if at >= 0 and at != last else 0
        called = at if self.here == round(0.6 / DT) else -1
        if called >= 0:
            self.calls = [*self.calls, called][-len(ORDER) :]
            if [list(STATIONS)[k] for k in self.calls] == ORDER:
                self.bonus = round(1 / DT)  # a second of reward
        reward, self.bonus = 2.0 * (self.bonus > 0), max(self.bonus - 1, 0)
        return self._seen(), reward, False, False, {"called": np.int64(called)}

    def _seen(self):
        return {"position": np.array([self.position], np.float32)}


class CartState(NamedTuple):
    place: FieldState


class Cart(Sensorimotor[CartState]):
    """Where am I, am I there, and how fast to go: senses and motors of the rail."""

    senses = ("position",)

    def __init__(self, sites: int = 81) -> None:
        super().__init__(DT, max_speed=2.0)
        self.n = len(STATIONS)
        self.place = DNF(sites, (Gauss(4.0, 2.0), Global(-0.4)), border="zero", dt=DT)
        rail, stations = torch.linspace(-1, 1, sites), torch.tensor(list(STATIONS.values()))
        near = ((rail - stations.unsqueeze(-1)).abs() < 0.04).float()
        for name, numbers in {"rail": rail, "stations": stations, "near": near}.items():
            self.register_buffer(name, numbers, persistent=False)

    def match(self, _observation: dict[str, Tensor], state: CartState) -> Tensor:
        return (self.place.output(state.place) @ self.near.t() / 2).clamp_max(1.0)

    def advance(
        self, observation: dict[str, Tensor], intention: Tensor, state: CartState
    ) -> CartState:
        seen = 8 * torch.exp(-0.5 * ((self.rail - observation["position"]) / 0.05) ** 2)
        return CartState(self.place.euler(seen, state.place))

    def act(self, intention: Tensor, state: CartState) -> Tensor:
        peak = self.place.output(state.place)
        position = (peak * self.rail).sum(-1) / peak.sum(-1).clamp_min(1e-3)
        pull = intention * (self.stations - position.unsqueeze(-1))
        return 3.0 * pull.sum(-1, keepdim=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--explore", type=int, default=16_000, help="control steps")
    parser.add_argument("--exploit", type=int, default=8_000)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    settle()

    agent = DNSarsa(len(STATIONS), Cart())
    noise = Exploration(agent.n, arguments.seed)
    policy = AgentPolicy(agent, arguments.explore, noise)
    world = wrap(Rail(), called=Unbounded((), dtype=torch.int64))
    total = arguments.explore + arguments.exploit
    collector = Collector(world, policy, frames_per_batch=2_000, total_frames=total)
    for k, batch in enumerate(collector):
        calls = int((batch["next", "called"] >= 0).sum())
        bonus = batch["next", "reward"][:, 0] > 0
        rewards = int((bonus[1:] & ~bonus[:-1]).sum())
        phase = "explores" if (k + 1) * 2_000 <= arguments.explore else "exploits"
        print(f"{phase}: {calls} calls, {rewards} rewarded", flush=True)
    print("values, rows: after a call at; columns: go to")
    print(" " * 5 + "".join(f"{name:>7}" for name in STATIONS))
    for name, row in zip(STATIONS, agent.weights.t().tolist()):
        print(f"{name:5}" + "".join(f"{value:7.2f}" for value in row))


if __name__ == "__main__":
    main()
