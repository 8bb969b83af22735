"""The step of the agent without senses, written as loops over agents: for numba."""

import numba
import numpy as np
from arrays import preference

LEAST, DT = np.float32(1e-9), np.float32(1 / 32)


@numba.njit
def sigmoid(u):
    return np.float32(0.5) + np.float32(50) * u / (1 + abs(100 * u))


@numba.njit
def advance(nodes, pairs, error, match, reward, base, rates, drive):
    """One step of one agent in place; returns its error."""
    intention, satisfaction, value = nodes
    pulse, inhibitory, trace, opposition, weights = pairs
    total = opposed = np.float32(0)
    best = LEAST
    for i in range(4):
        rates[0, i], rates[1, i] = sigmoid(intention[i]), sigmoid(satisfaction[i])
    sums = rates[0].sum(), rates[1].sum()
    wanted = np.zeros(4, np.float32)
    for i in range(4):
        for j in range(4):
            wanted[i] += weights[i, j] * (rates[1, j] > 0.5)
            positive = pulse[i, j] if pulse[i, j] > 0.05 else np.float32(0)
            drive[i, j] = 1.1 * positive + 0.8 * trace[i, j]
            total += drive[i, j]
            opposed += opposition[i, j]
        wanted[i] = (max(wanted[i], 0) + base[i]) * (rates[1, i] <= 0.5)
        best = max(best, wanted[i])
    signal = np.float32(0.06) * (reward + error)
    for i in range(4):
        fi, fc = rates[0, i], rates[1, i]
        target = -5 + 10 * fi - 30 * (sums[0] - fi) + 10 * value[i] - 20 * fc
        percept = -5 + 8 * fc - 8 * (sums[1] - fc) + 15 * match[i] - 2 * (sums[0] - fi)
        intention[i] = max(intention[i] + DT / 0.3 * (target - intention[i]), -12)
        satisfaction[i] += DT / 0.3 * (percept - satisfaction[i])
        value[i] += DT / 0.1 * ((wanted[i] / best) ** 8 - value[i])
        for j in range(4):
            active = np.float32(i != j and fi * rates[1, j] > 0.5)
            p, u = pulse[i, j], trace[i, j]
            known = weights[i, j] if u > 0.01 else np.float32(0)
            input = known * (0.8 * (p > 0.05) - 1.0 * (p < -0.05))
            pulse[i, j] += DT / 0.5 * (active - p - inhibitory[i, j])
            inhibitory[i, j] += DT / 0.5 * (active - inhibitory[i, j])
            opposition[i, j] += DT / 0.1 * (input - opposition[i, j])
            weights[i, j] += DT * (1 - active) * u * signal
            trace[i, j] += DT * (drive[i, j] - u * total)
    return error + DT / np.float32(0.1) * (opposed - error)


@numba.njit
def run(nodes, pairs, error, match, reward, base):
    """Steps ``match[t, agent, 4]``; nodes ``[agent, 3, 4]``, pairs ``[agent, 5, 4, 4]``."""
    rates, drive = np.zeros((2, 4), np.float32), np.zeros((4, 4), np.float32)
    for t in range(match.shape[0]):
        for k in range(match.shape[1]):
            error[k] = advance(
                nodes[k], pairs[k], error[k], match[t, k], reward[t, k], base, rates, drive
            )


class Loops:
    """The loops, compiled by numba."""

    def __init__(self, match: np.ndarray, reward: np.ndarray) -> None:
        batch = match.shape[1]
        self.inputs = match, reward, preference()
        self.nodes = np.zeros((batch, 3, 4), np.float32)
        self.nodes[:, :2] = -5
        self.pairs = np.zeros((batch, 5, 4, 4), np.float32)
        self.error = np.zeros(batch, np.float32)

    def __call__(self) -> None:
        run(self.nodes, self.pairs, self.error, *self.inputs)

    @property
    def weights(self) -> np.ndarray:
        return self.pairs[:, 4]
