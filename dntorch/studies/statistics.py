"""Statistics that can fail, and what theory expects of the neural learner."""

import math
from typing import NamedTuple

import numpy as np
from scipy import optimize, stats

ALPHA = 0.05
"""Level of every test."""


class Fit(NamedTuple):
    """Least squares without intercept."""

    coefficients: np.ndarray
    errors: np.ndarray
    """standard errors"""
    r2: float
    """share of the variance about the mean that is explained"""
    count: int


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


def wilson(successes: int, count: int, confidence: float = 0.95) -> tuple[float, float]:
    """Wilson's interval of a proportion.

    >>> [round(x, 4) for x in wilson(9, 10)]
    [0.5958, 0.9821]
    """
    if count == 0:
        return 0.0, 1.0
    interval = stats.binomtest(successes, count).proportion_ci(confidence, method="wilson")
    return float(interval.low), float(interval.high)


def equivalent_proportions(
    a: tuple[int, int], b: tuple[int, int], margin: float
) -> dict[str, float | bool | None]:
    """Two one-sided tests that two proportions (k, n) differ by less than ``margin``.

    Score tests of Farrington and Manning, which stay valid when a proportion is 0 or 1
    (statsmodels, method "score"): the p value is that of the weaker side. ``decidable`` says
    whether so many runs could have shown it: all of both succeed, and p is below `ALPHA`.
    """
    if a[1] == 0 or b[1] == 0:
        return {"difference": None, "p": 1.0, "margin": margin, "decidable": False}
    return {
        "difference": a[0] / a[1] - b[0] / b[1],
        "p": _weaker_side(a, b, margin),
        "margin": margin,
        "decidable": _weaker_side((a[1], a[1]), (b[1], b[1]), margin) < ALPHA,
    }


def _weaker_side(a: tuple[int, int], b: tuple[int, int], margin: float) -> float:
    from statsmodels.stats.proportion import score_test_proportions_2indep as score

    return max(
        # Degenerate variance (all or none succeed in both) cannot occur at a shifted value.
        float(score(*a, *b, value=value, alternative=side, correction=False).pvalue)
        for value, side in ((-margin, "larger"), (margin, "smaller"))
    )


def equivalent_means(a: np.ndarray, b: np.ndarray, margin: float) -> dict[str, float | bool | None]:
    """Two one-sided Welch tests that the mean of ``a`` is within ``margin`` (a share) of b's.

    ``decidable`` says whether so many values, spread as they are, could have shown it: with
    equal means p is below `ALPHA`.
    """
    from statsmodels.stats.weightstats import ttost_ind

    if len(a) < 2 or len(b) < 2:
        return {"ratio": None, "p": 1.0, "margin": margin, "decidable": False}
    mean, other = float(np.mean(a)), float(np.mean(b))
    bounds = (-margin * other, margin * other)
    p, same = (ttost_ind(x, b, *bounds, usevar="unequal")[0] for x in (a, a - mean + other))
    return {
        "ratio": mean / other, "p": float(p), "margin": margin, "decidable": bool(same < ALPHA),
    }  # fmt: skip


def uniformity(counts: np.ndarray) -> dict[str, float | int | bool]:
    """Chi-square test of equal frequencies; ``decidable`` with five or more expected in each."""
    dof, total = len(counts) - 1, counts.sum()
    chi2, p = stats.chisquare(counts) if total else (0.0, 1.0)
    return {
        "chi2": float(chi2),
        "dof": dof,
        "p": float(p),
        "cramers_v": math.sqrt(chi2 / max(total * dof, 1)),
        "decidable": bool(counts.mean() >= 5),
    }


def regression(regressors: np.ndarray, response: np.ndarray) -> Fit:
    """Least squares of ``response`` on the columns of ``regressors``, without intercept."""
    count, columns = regressors.shape
    if count <= columns:
        nothing = np.full(columns, np.nan)
        return Fit(nothing, nothing, math.nan, count)
    solution, _, _, _ = np.linalg.lstsq(regressors, response, rcond=None)
    residual = response - regressors @ solution
    about_mean = ((response - response.mean()) ** 2).sum()
    scale = (residual**2).sum() / (count - columns)
    covariance = scale * np.linalg.pinv(regressors.T @ regressors)
    r2 = 1 - (residual**2).sum() / about_mean if about_mean > 0 else math.nan
    return Fit(solution, np.sqrt(np.diag(covariance)), float(r2), count)


def summary(values: np.ndarray) -> dict[str, float | int | None]:
    """Median and quartiles."""
    values = np.asarray(values, float)
    if len(values) == 0:
        return {"median": None, "quartiles": [None, None], "mean": None, "count": 0}
    low, median, high = np.percentile(values, [25, 50, 75])
    return {
        "median": float(median),
        "quartiles": [float(low), float(high)],
        "mean": float(values.mean()),
        "count": len(values),
    }


def mean_interval(values: np.ndarray) -> tuple[float, float]:
    """95 % interval of a mean, by Student's t."""
    values = np.asarray(values, float)
    if len(values) < 2:
        return -math.inf, math.inf
    half = stats.t.ppf(0.975, len(values) - 1) * values.std(ddof=1) / math.sqrt(len(values))
    return float(values.mean() - half), float(values.mean() + half)


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


def theory(
    learning_rate: float,
    tau_trace: float,
    reward_area: float,
    gap: float,
    excitation: float = 1.1,
    tau_pulse: float = 0.5,
    threshold: float = 0.05,
    discount: float = 0.8,
    tau_opposition: float = 0.1,
    tau_error: float = 0.1,
    reward_duration: float = 1.0,
) -> Theory:
    """Effective learning rates and lambda from parameters alone.

    A pulse of area A multiplies all other items of a settled memory by exp(-alpha A / tau).
    The old pair learns while its offset pulse and the onset pulse of the new pair, ``gap``
    seconds later, are above threshold; meanwhile the new pulse makes its trace fade.
    """
    begin, end, area = pulse_above(threshold, tau_pulse)
    decay = math.exp(-excitation * area / tau_trace)
    dt = 1e-3
    t = np.arange(0, end + gap + 10 * (tau_opposition + tau_error), dt)
    x = np.clip(t - gap, 0, None) / tau_pulse
    pulse = x * np.exp(-x)
    pulse[pulse <= threshold] = 0
    trace = (1 - decay) * np.exp(-excitation * np.cumsum(pulse) * dt / tau_trace)

    def response(start: float, stop: float) -> float:
        gate = ((t > start) & (t <= stop)).astype(float)
        for tau in (tau_opposition, tau_error):
            gate = _low_pass(gate, tau, dt)
        return float((gate * trace).sum() * dt)

    rate, paid = learning_rate, t < reward_duration
    reward = reward_area / reward_duration * float(trace[paid].sum() * dt)
    return Theory(
        decay,
        decay / discount,
        end - begin,
        rate * (1 - decay) * (end - begin),
        rate * response(begin, end),
        rate * response(begin + gap, end + gap),
        rate * reward,
    )


def _low_pass(signal: np.ndarray, tau: float, dt: float) -> np.ndarray:
    from scipy.signal import lfilter

    return lfilter([dt / tau], [1, dt / tau - 1], signal)
