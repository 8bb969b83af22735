"""Item-and-order memory as the eligibility trace of a plain linear SARSA(lambda).

No nodes, no fields, no robot: a textbook learner with one weight for each pair (action, state),
whose trace is not the usual decaying number but the paper's working memory. A pair that is
chosen sends one pulse into the memory; then the action takes its time, a different time each
time, in which the memory runs on. Between pulses it keeps every ratio, so what counts is the
order of events and not the seconds between them; a pulse of area A multiplies what is older by
exp(-alpha A / tau), which is gamma lambda.

You see the decay per event against that number, for waits of 1 to 60 s; then in how many of 64
seeds the learner ends up with a rewarded sequence of four (reward only after the fourth): with
the memory as a trace, with the textbook's trace of the same decay, and with none (lambda = 0).
Section III.C of Kazerounian, Luciw, Richter and Sandamirskaya, "Autonomous Reinforcement of
Behavioral Sequences in Neural Dynamics". Ten seconds on one core.

    python recipes/trace_sarsa.py --decisions 600
"""

import argparse
import math

import torch
from torch import Tensor

from dntorch import ItemOrderWM
from dntorch.envs import SequenceTask
from dntorch.noise import keyed_uniform
from dntorch.process import settle

DT, PULSE, GAMMA, RATE = 1 / 32, 16, 0.9, 0.05  # s, steps of a pulse of size 1, -, per decision
MEMORY = {"tau": 1.0, "excitation": 1.1, "feedback": 0.8, "dt": DT}
DECAY = math.exp(-MEMORY["excitation"] * PULSE * DT / MEMORY["tau"])


class MemoryTrace:
    """`ItemOrderWM` that lives through a pulse and a wait for each event."""

    def __init__(self, n: int, batch: int) -> None:
        self.memory = ItemOrderWM(n, **MEMORY).resize(batch)

    def __call__(self, chosen: Tensor, wait: int) -> Tensor:
        for _ in range(PULSE):
            self.memory(chosen)
        for _ in range(wait):
            self.memory(torch.zeros_like(chosen))
        return self.memory.u


class TextbookTrace:
    """Accumulating trace of SARSA(lambda); with the sum of the memory's for a fair rate."""

    def __init__(self, n: int, batch: int, decay: float = DECAY) -> None:
        self.decay, self.trace = decay, torch.zeros(batch, n, n)

    def __call__(self, chosen: Tensor, wait: int) -> Tensor:
        self.trace = self.decay * self.trace + (1 - self.decay) * chosen
        return self.trace


def ratios(waits: list[int]) -> list[float]:
    """How much of an older pair is left, after one more pulse, relative to nothing happening."""
    left = []
    for wait in waits:
        trace = MemoryTrace(3, 1)
        pairs = torch.eye(9).view(9, 1, 3, 3)
        for event in range(3):
            before = trace(pairs[event], wait).clone()
        after = trace(pairs[3], wait)
        left.append(float(after[0].flatten()[2] / before[0].flatten()[2]))
    return left


def learn(trace, seeds: Tensor, decisions: int, task: SequenceTask) -> Tensor:
    """Rewards in the last 40 decisions of each seed; explores for the first three quarters."""
    n, batch = len(task.colors), len(seeds)
    weights = torch.zeros(batch, n, n)  # [action, state]
    rows = torch.arange(batch)
    state, task_state = torch.zeros(batch, dtype=torch.int64), task.initial((batch,))
    previous, eligible = torch.zeros(batch), torch.zeros(batch, n, n)
    late = torch.zeros(batch)
    reward = torch.zeros(batch)
    for t in range(decisions):
        draw = keyed_uniform(0, seeds, torch.full_like(seeds, t), n + 1, 0)
        noise = 10 * draw[:, :n] if t < 0.75 * decisions else 1e-3 * draw[:, :n]
        own = torch.nn.functional.one_hot(state, n) * 100  # a finished action may not win again
        action = (weights[rows, :, state] + noise - own).argmax(-1)
        value = weights[rows, action, state]
        error = reward + GAMMA * value - previous  # of SARSA: what follows is Q(s', a')
        weights += RATE * error[:, None, None] * eligible
        previous = weights[rows, action, state]
        chosen = torch.zeros(batch, n, n)
        chosen[rows, action, state] = 1.0
        eligible = trace(chosen, 32 + int(160 * draw[0, n]))
        _, completed, task_state = task.step(action, task_state)
        reward, state = 4.0 * completed, action
        late += completed * (t >= decisions - 40)
    return late


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--decisions", type=int, default=600)
    parser.add_argument("--seeds", type=int, default=64)
    arguments = parser.parse_args()
    settle()

    print(f"decay per event: exp(-alpha A / tau) = {DECAY:.3f}")
    waits = [1, 4, 15, 60]
    for seconds, ratio in zip(waits, ratios([round(s / DT) for s in waits])):
        print(f"  with waits of {seconds:2} s: {ratio:.3f}", flush=True)
    seeds, task = torch.arange(arguments.seeds), SequenceTask()
    n, batch = len(task.colors), arguments.seeds
    for name, trace in (
        ("item-and-order memory", MemoryTrace(n, batch)),
        ("textbook trace", TextbookTrace(n, batch)),
        ("no trace, lambda = 0", TextbookTrace(n, batch, decay=0.0)),
    ):
        late = learn(trace, seeds, arguments.decisions, task)
        print(f"{name}: {int((late >= 9).sum())} of {batch} optimal, {late.mean():.1f} "
              "rewards in the last 40 decisions (10 is the most)", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
