"""Statistics that can fail."""

import math
from typing import NamedTuple

import numpy as np
from scipy import stats

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
