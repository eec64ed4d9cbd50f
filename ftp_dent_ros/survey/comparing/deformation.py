"""How one survey's map lies in another's: a rigid motion, and what the maps have drifted.

A survey's map is put together of clouds, each on the last ones, so that two places of it are the
less sure of each other the farther apart they are: errors walk. The difference of two maps is
modelled as a small rigid motion (of which nothing is known) and a random walk along the skin:
a Gaussian process, found from the dents that were matched (universal kriging; Cressie, Statistics
for Spatial Data, 1993, section 3.4).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial.distance import cdist

Array = NDArray[np.float64]

# The walk is forgotten over so many metres: much longer than what clouds see at once.
_LENGTH = 20.0
# What a motion found from two dents may leave: metres, and radians.
_FREE_SHIFT, _FREE_TURN = 0.05, 0.02
# Variance of a component that a metre of walk adds, square metres: from hundredths of a millimetre
# (clouds laid on each other by their skin) to centimetres (by an autopilot).
_WALKS = np.geomspace(1e-10, 1e-4, 13)
# What is expected of it before there are dents: a millimetre over a metre, give or take a factor
# of ten (natural logarithm of a variance).
_EXPECTED, _GIVE_OR_TAKE = 1e-6, 4.6


@dataclass(frozen=True, eq=False)
class Deformation:
    """Where places of one map lie in the other.

    Attributes
    ----------
    at : ndarray, shape (n, 3)
        Places that were matched, metres, about `middle`.
    middle : ndarray, shape (3,)
    weights : ndarray, shape (n, 3)
        Of the kriging.
    factor : tuple
        Cholesky factor of the covariance of the n shifts along each axis.
    walk : float
        Variance that a metre adds, square metres.
    """

    at: Array
    middle: Array
    weights: Array
    factor: tuple[Array, bool]
    walk: float

    def shift(self, places: Array) -> tuple[Array, Array]:
        """Shifts of places, shape (m, 3), and the standard deviation of each, shape (m,)."""
        places = places - self.middle
        across = _covariance(places, self.at, self.walk)
        prior = _FREE_SHIFT**2 + _FREE_TURN**2 * (places**2).sum(axis=1) + self.walk * _LENGTH
        explained = (across * cho_solve(self.factor, across.T).T).sum(axis=1)
        return across @ self.weights, np.sqrt(np.maximum(prior - explained, 0.0))


def fit(at: Array, shifts: Array, spreads: Array) -> Deformation:
    """The likeliest deformation.

    Parameters
    ----------
    at, shifts : ndarray, shape (n, 3)
        Places and their shifts into the other map, metres; n is at least 1.
    spreads : ndarray, shape (n,)
        Standard deviation of each shift without the maps' own errors, metres.
    """
    middle = at.mean(axis=0)
    best: tuple[float, Deformation] | None = None
    for walk in _WALKS:
        covariance = _covariance(at - middle, at - middle, walk) + np.diag(spreads**2)
        factor = cho_factor(covariance, lower=True)
        weights = cho_solve(factor, shifts)
        likelihood = -0.5 * float((shifts * weights).sum())
        likelihood -= 3 * float(np.log(np.diag(factor[0])).sum())
        likelihood -= 0.5 * (float(np.log(walk / _EXPECTED)) / _GIVE_OR_TAKE) ** 2
        if best is None or likelihood > best[0]:
            best = likelihood, Deformation(at - middle, middle, weights, factor, float(walk))
    assert best is not None
    return best[1]


def _covariance(a: Array, b: Array, walk: float) -> Array:
    """Of the shifts along one axis at two sets of places about the middle."""
    rigid = _FREE_SHIFT**2 + _FREE_TURN**2 * a @ b.T
    return rigid + walk * _LENGTH * np.exp(-cdist(a, b) / _LENGTH)
