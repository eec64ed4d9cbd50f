"""Probability of detection from hits and misses, and the dent that is surely found.

Source: MIL-HDBK-1823A, appendix G (hit/miss), with the logarithm of the depth as the size, that of
the width beside it, and Firth's penalty (Biometrika 80, 27, 1993), for which every fit is finite:
also where the deep ones are all found and the shallow ones all missed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, minimize
from scipy.stats import chi2

# The probability of detection that a90 has its name from (MIL-HDBK-1823A).
_POD = 0.9
# Of the profile likelihood: one-sided 95 %.
_DEVIANCE = float(chi2.ppf(0.90, 1))
# Sizes are counted in these: logarithms of order 1.
_DEPTH, _WIDTH = 1e-4, 0.03
_FEWEST = 10
# Where bounds are looked for, in logarithms of the depth.
_DEEPEST = math.log(100.0)

Values = NDArray[np.float64]


@dataclass(frozen=True)
class Detection:
    """What a set of hits and misses says of dents of one width.

    Attributes
    ----------
    dents, hits : int
    a90 : float
        Depth that is found in 90 % of cases, metres; NaN if the set does not tell.
    a90_95 : float
        Its upper bound with a confidence of 95 %, metres; NaN if there is none.
    coefficients : tuple of 3 floats
        Of 1, ln(depth / 0.1 mm) and ln(width / 30 mm) in the logit.
    """

    dents: int
    hits: int
    a90: float
    a90_95: float
    coefficients: tuple[float, float, float]

    def probability(self, depth: Values, width: float) -> Values:
        """At depths and a width, metres."""
        b0, b1, b2 = self.coefficients
        logit = b0 + b1 * np.log(np.asarray(depth) / _DEPTH) + b2 * math.log(width / _WIDTH)
        return 1 / (1 + np.exp(-np.clip(logit, -500, 500)))


def detection(depths: Values, widths: Values, hits: Values, width: float = _WIDTH) -> Detection:
    """Fit hits (1) and misses (0) of dents, shape (n,), metres; sizes are told at one width."""
    count, found = len(hits), int(np.sum(hits))
    if count < _FEWEST or found in (0, count):
        return Detection(count, found, math.nan, math.nan, (math.nan,) * 3)
    columns = np.stack([np.ones(count), np.log(depths / _DEPTH), np.log(widths / _WIDTH)], axis=1)
    hits = np.asarray(hits, float)
    best = _maximum(lambda b: _likelihood(b, columns, hits), np.array([0.0, 2.0, 0.0]))
    top = _likelihood(best, columns, hits)
    wanted, beside = math.log(_POD / (1 - _POD)), math.log(width / _WIDTH)
    coefficients = float(best[0]), float(best[1]), float(best[2])
    if best[1] <= 0:
        return Detection(count, found, math.nan, math.nan, coefficients)
    a90 = (wanted - best[0] - best[2] * beside) / best[1]

    def excess(size: float) -> float:
        def bound(rest: Values) -> Values:
            return np.array([wanted - rest[0] * size - rest[1] * beside, *rest])

        rest = _maximum(lambda r: _likelihood(bound(r), columns, hits), best[1:])
        return 2 * (top - _likelihood(bound(rest), columns, hits)) - _DEVIANCE

    bound = math.nan
    if excess(_DEEPEST) > 0:
        bound = _DEPTH * math.exp(brentq(excess, a90, _DEEPEST, xtol=1e-3))
    return Detection(count, found, _DEPTH * math.exp(a90), bound, coefficients)


def most_calls(calls: int, area: float) -> float:
    """Upper bound, with a confidence of 95 %, of false calls a square metre."""
    return float(chi2.ppf(0.95, 2 * calls + 2)) / 2 / area if area > 0 else math.nan


def _likelihood(b: Values, columns: Values, hits: Values) -> float:
    """Logarithm of the likelihood, with half of that of the information's determinant."""
    logit = np.clip(columns @ b, -30, 30)
    p = 1 / (1 + np.exp(-logit))
    information = columns.T @ (columns * (p * (1 - p))[:, None])
    _, determinant = np.linalg.slogdet(information + 1e-12 * np.eye(len(b)))
    return float((hits * logit - np.logaddexp(0, logit)).sum() + determinant / 2)


def _maximum(function, start: Values) -> Values:
    return np.asarray(minimize(lambda b: -function(b), start, method='Nelder-Mead').x, float)
