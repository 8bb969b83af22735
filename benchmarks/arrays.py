"""The step of the agent without senses, written on whole arrays: for NumPy and for JAX."""

from types import ModuleType
from typing import Any

import numpy as np

from dntorch import DNSarsa

State = dict[str, Any]
DT = np.float32(1 / 32)
OFF_DIAGONAL = (1 - np.eye(4)).astype(np.float32)


def preference() -> np.ndarray:
    """What the value nodes suggest where nothing was learned."""
    nodes = DNSarsa(4).value_nodes
    return (nodes.baseline * nodes.ladder).numpy()


def at_rest(batch: int) -> State:
    nodes, pairs = np.zeros((batch, 4), np.float32), np.zeros((batch, 4, 4), np.float32)
    state = {"intention": nodes - 5, "satisfaction": nodes - 5, "value": nodes}
    state |= dict.fromkeys(("pulse", "inhibitory", "trace", "opposition", "weights"), pairs)
    return state | {"error": np.zeros(batch, np.float32)}


def sigmoid(u: Any) -> Any:
    return 0.5 + 0.5 * 100 * u / (1 + abs(100 * u))


def step(np: ModuleType, s: State, match: Any, reward: Any, noise: Any, base: Any) -> State:
    """One step with the functions of ``np``: NumPy's or JAX's."""
    fi, fc = sigmoid(s["intention"]), sigmoid(s["satisfaction"])
    others_i, others_c = fi.sum(-1, keepdims=True) - fi, fc.sum(-1, keepdims=True) - fc
    on = (fc > 0.5).astype(np.float32)
    learned = (s["weights"] * on[..., None, :]).sum(-1) + noise
    worth = (np.maximum(learned, 0) + base) * (1 - on)
    best = np.maximum(worth.max(-1, keepdims=True), 1e-9)
    active = (fi[..., :, None] * fc[..., None, :] > 0.5) * OFF_DIAGONAL
    p, u = s["pulse"], s["trace"]
    drive = 1.1 * np.where(p > 0.05, p, 0) + 0.8 * u
    opposed = np.where(u > 0.01, s["weights"], 0) * (0.8 * (p > 0.05) - 1.0 * (p < -0.05))
    signal = (0.06 * (reward + s["error"]))[..., None, None]
    target_i = -5 + 10 * fi - 30 * others_i + 10 * s["value"] - 20 * fc
    target_c = -5 + 8 * fc - 8 * others_c + 15 * match - 2 * others_i
    ahead = {
        "intention": np.maximum(s["intention"] + DT / 0.3 * (target_i - s["intention"]), -12),
        "satisfaction": s["satisfaction"] + DT / 0.3 * (target_c - s["satisfaction"]),
        "value": s["value"] + DT / 0.1 * ((worth / best) ** 8 - s["value"]),
        "pulse": p + DT / 0.5 * (active - p - s["inhibitory"]),
        "inhibitory": s["inhibitory"] + DT / 0.5 * (active - s["inhibitory"]),
        "trace": u + DT * (drive - u * drive.sum((-2, -1), keepdims=True)),
        "opposition": s["opposition"] + DT / 0.1 * (opposed - s["opposition"]),
        "error": s["error"] + DT / 0.1 * (s["opposition"].sum((-2, -1)) - s["error"]),
        "weights": s["weights"] + DT * (1 - active) * u * signal,
    }
    return {name: x.astype(np.float32) for name, x in ahead.items()}


class Arrays:
    """NumPy, batch first."""

    def __init__(self, match: np.ndarray, reward: np.ndarray) -> None:
        self.inputs = list(zip(match, reward))
        self.state, self.base = at_rest(match.shape[1]), preference()
        self.noise = np.zeros((match.shape[1], 4), np.float32)

    def __call__(self) -> None:
        for match, reward in self.inputs:
            self.state = step(np, self.state, match, reward, self.noise, self.base)

    @property
    def weights(self) -> np.ndarray:
        return np.asarray(self.state["weights"])


class Scanned(Arrays):
    """JAX: the same step, all steps of a portion in one compiled loop."""

    def __init__(self, match: np.ndarray, reward: np.ndarray) -> None:
        super().__init__(match, reward)
        import jax

        def advance(state: State, now: tuple[Any, Any]) -> tuple[State, None]:
            return step(jax.numpy, state, *now, self.noise, self.base), None

        self.stacked = jax.numpy.asarray(match), jax.numpy.asarray(reward)
        self.scan = jax.jit(lambda state, inputs: jax.lax.scan(advance, state, inputs)[0])

    def __call__(self) -> None:
        self.state = self.scan(self.state, self.stacked)
        self.state["weights"].block_until_ready()
