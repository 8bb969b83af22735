"""What theory expects of the neural learner, from its parameters alone."""

import math
from typing import NamedTuple

import numpy as np
from scipy import optimize
from scipy.signal import lfilter

from dntorch.modules.learner import Learner


class Theory(NamedTuple):
    """What the learner's parameters say about the SARSA(lambda) that it performs."""

    decay: float
    """of the trace at each transition, gamma lambda"""
    trace_decay: float
    """lambda"""
    width: float
    """s, of a pulse above the threshold"""
    settled: float
    """learning rate a transition if the trace of the old pair held still: eta (1 - decay) width"""
    old: float
    """expected coefficient of -Q(s,a): the same, with the trace that fades under the new pulse"""
    next: float
    """expected coefficient of gamma Q(s',a')"""
    reward: float
    """expected weight change by a reward: eta (1 - decay) times the reward's area, fading"""
    discount: float
    """gamma"""


def pulse_above(threshold: float, tau: float) -> tuple[float, float, float]:
    """Begin, end and area of the pulse (t/tau) exp(-t/tau) while it is above ``threshold``.

    >>> [round(x, 3) for x in pulse_above(0.05, 0.5)]
    [0.026, 2.25, 0.469]
    """
    if not 0 < threshold < 1 / math.e:
        raise ValueError(f"threshold={threshold}: a pulse has its peak at 1/e, give less, above 0")

    def above(x: float) -> float:
        return x * math.exp(-x) - threshold

    begin, end = optimize.brentq(above, 0, 1), optimize.brentq(above, 1, 100)
    area = tau * ((1 + begin) * math.exp(-begin) - (1 + end) * math.exp(-end))
    return begin * tau, end * tau, area


def theory(learner: Learner, gap: float, reward: float, reward_duration: float) -> Theory:
    """Effective learning rates and lambda of a learner, read from its parameters.

    A pulse of area A multiplies all other items of a settled memory by exp(-alpha A / tau).
    The old pair learns while its offset pulse and the onset pulse of the new pair, ``gap``
    seconds later, are above threshold; meanwhile the new pulse makes its trace fade.

    Args:
        learner: of one agent, or of a batch whose parameters do not differ.
        gap: s, from the end of a pair to the begin of the next.
        reward, reward_duration: size of the reward signal, and its length in s.
    """
    memory, opposition = learner.trace, learner.opposition
    tau, dt = learner.pulses.tau, 1e-3
    begin, end, _ = pulse_above(opposition.pulse_threshold, tau)
    _, _, area = pulse_above(memory.threshold, tau)
    decay = math.exp(-memory.excitation * area / memory.tau)
    t = np.arange(0, end + gap + 10 * (opposition.tau + opposition.tau_error), dt)
    x = np.clip(t - gap, 0, None) / tau
    pulse = x * np.exp(-x)
    pulse[pulse <= memory.threshold] = 0
    trace = (1 - decay) * np.exp(-memory.excitation * np.cumsum(pulse) * dt / memory.tau)

    def response(start: float, stop: float) -> float:
        gate = ((t > start) & (t <= stop)).astype(float)
        for constant in (opposition.tau, opposition.tau_error):
            gate = _low_pass(gate, constant, dt)
        return float((gate * trace).sum() * dt)

    rate = learner.values.learning_rate
    return Theory(
        decay=decay,
        trace_decay=decay / opposition.discount,
        width=end - begin,
        settled=rate * (1 - decay) * (end - begin),
        old=rate * response(begin, end),
        next=rate * response(begin + gap, end + gap),
        reward=rate * (reward * float(trace[t < reward_duration].sum() * dt)),
        discount=opposition.discount,
    )


def _low_pass(signal: np.ndarray, tau: float, dt: float) -> np.ndarray:
    return lfilter([dt / tau], [1, dt / tau - 1], signal)
