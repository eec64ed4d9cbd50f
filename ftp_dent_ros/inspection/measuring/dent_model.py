"""The dent function (eq. 18) fitted to a deviation."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

_ROUNDS = 25
# Of one round at most, in the order of the parameters: logarithms of the half axes, radians.
_STRIDES = np.array([math.inf, math.inf, 0.3, 0.3, 0.5, math.inf])
_ENDED = 1e-3
# Sides of squares of cells whose means tell how many err alike, how many squares that takes, and
# how much more they do than is seen: a fit follows what is alike over much of a dent.
_SQUARES = 2, 3, 4, 6
_FEWEST = 8
_HIDDEN = 4.0
_SINGULAR = 1e-9
# exp(1 - 1/q) and its slopes vanish below.
_RIM = 2e-2

Field = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class DentModel:
    """``depth * exp(1 - 1 / (1 - r^2))`` inside an ellipse, with its covariance.

    Attributes
    ----------
    parameters : ndarray, shape (6,)
        x, y, logarithms of the half axes (metres), angle (radians), depth (metres).
    covariance : ndarray, shape (6, 6)
    is_determined : bool
        Whether the data have a solution: the fit came to an end, and no parameter is free.
    """

    parameters: NDArray[np.float64]
    covariance: NDArray[np.float64]
    is_determined: bool

    def depth(self, x: Field, y: Field) -> Field:
        """Depth at positions, metres."""
        return dent_function(self.parameters, x, y)

    @property
    def axes(self) -> tuple[float, float]:
        """Full axes, the longer first, metres."""
        a, b = (2 * math.exp(half) for half in self.parameters[2:4])
        return max(a, b), min(a, b)

    @property
    def axes_uncertainty(self) -> tuple[float, float]:
        """Standard uncertainty of `axes`, metres."""
        spread = 2 * np.exp(self.parameters[2:4]) * np.sqrt(np.diag(self.covariance)[2:4])
        first, second = spread if self.parameters[2] >= self.parameters[3] else spread[::-1]
        return float(first), float(second)

    @property
    def angle_uncertainty(self) -> float:
        """Standard uncertainty of the angle, radians; that of any angle at most."""
        return min(math.sqrt(self.covariance[4, 4]), math.pi / math.sqrt(12))


def dent_function(parameters: NDArray, x: Field, y: Field) -> Field:
    """Eq. 18 at x, y, for the parameters of `DentModel`."""
    return _Function(parameters, x, y).depth


def fit_dent(
    x: Field, y: Field, depth: Field, known: NDArray[np.bool_], start: Field, correlated: float
) -> DentModel:
    """Fit a dent function by damped least squares (Levenberg and Marquardt).

    Parameters
    ----------
    x, y, depth, known : ndarray, shape (rows, columns)
        Positions and depths, metres, and where they are measured.
    start : ndarray, shape (6,)
        Parameters to begin with.
    correlated : float
        Number of cells whose noise is one independent value, at most.
    """
    shape, damping = np.asarray(start, float).copy(), 1e-3
    x, y, data = x[known], y[known], depth[known]
    function = _Function(shape, x, y)
    left = data - function.depth
    cost = left @ left
    ended = False
    for _ in range(_ROUNDS):
        slopes = function.slopes()
        normal, gradient = slopes @ slopes.T, slopes @ left
        # A dent that has left the grid has no slopes, and stays where it is.
        diagonal = np.where(normal.diagonal() > 0, normal.diagonal(), 1.0)
        while True:
            damped = normal.copy()
            damped.flat[:: len(damped) + 1] += (damping + 1e-12) * diagonal
            change = np.linalg.solve(damped, gradient)
            trial = shape + np.minimum(np.maximum(change, -_STRIDES), _STRIDES)
            function_then = _Function(trial, x, y)
            left_then = data - function_then.depth
            cost_then = left_then @ left_then
            if cost_then <= cost or damping > 1e4:
                break
            damping *= 8
        if damping > 1e4:
            # No way leads down: this is the least.
            ended = True
            break
        gain = cost - cost_then
        shape, function, left, cost = trial, function_then, left_then, cost_then
        damping = max(damping / 8, 1e-9)
        if abs(gain) <= _ENDED * cost:
            ended = True
            break
    slopes = function.slopes()
    together = min(max(correlated, 1.0), _HIDDEN * _correlated_cells(left, known))
    variance = together * cost / max(len(data) - len(shape), 1)
    inverse, is_regular = _inverse(slopes @ slopes.T)
    covariance = variance * inverse
    finite = bool(np.isfinite(shape).all() and np.isfinite(covariance).all())
    return DentModel(shape, covariance, ended and is_regular and finite)


def _inverse(normal: Field) -> tuple[Field, bool]:
    """Inverse of a normal matrix, and whether it has one.

    What it does not determine is left very uncertain.
    """
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-30))
    values, vectors = np.linalg.eigh(normal / np.outer(scale, scale))
    inverse = (vectors / np.maximum(values, _SINGULAR)) @ vectors.T
    # The angle of what is round is free, and nothing else may be.
    regular = bool((np.diag(normal) > 0)[[0, 1, 2, 3, 5]].all())
    return inverse / np.outer(scale, scale), regular and int((values < _SINGULAR).sum()) < 2


def _correlated_cells(left: Field, known: NDArray[np.bool_]) -> float:
    """Number of cells that err alike, from the means of squares of cells."""
    both = np.zeros((*known.shape, 2))
    both[known, 0], both[..., 1] = left, known
    single = left @ left / max(len(left), 1)
    largest = 1.0
    for side in _SQUARES:
        size = known.shape[1] // side, known.shape[0] // side
        whole = both[: size[1] * side, : size[0] * side]
        errors, share = cv2.split(cv2.resize(whole, size, interpolation=cv2.INTER_AREA))
        means = errors[share > 0.99]
        if len(means) >= _FEWEST:
            largest = max(largest, side**2 * float(means @ means / len(means) / single))
    return largest


class _Function:
    """Eq. 18 at some places, and what its slopes along the parameters share with it."""

    def __init__(self, parameters: Field, x: Field, y: Field) -> None:
        self._c, self._s = math.cos(parameters[4]), math.sin(parameters[4])
        self._a, self._b = (math.exp(min(max(half, -12), 3)) for half in parameters[2:4])
        dx, dy = x - parameters[0], y - parameters[1]
        self._u = (self._c * dx + self._s * dy) / self._a
        self._v = (self._c * dy - self._s * dx) / self._b
        inside = 1 - self._u * self._u - self._v * self._v
        self._q = np.maximum(inside, _RIM)
        self._shape = np.exp(1 - 1 / self._q)
        self._shape[inside <= _RIM] = 0
        self._depth = parameters[5]

    @property
    def depth(self) -> Field:
        """Depths, metres."""
        return self._depth * self._shape

    def slopes(self) -> Field:
        """Derivatives of the depths along the parameters, shape (6, places)."""
        c, s, a, b, u, v = self._c, self._s, self._a, self._b, self._u, self._v
        # Of the height with the square radius, twice.
        slope = -2 * self._depth * self._shape / (self._q * self._q)
        along, across = slope * u, slope * v
        return np.stack(
            [
                across * (s / b) - along * (c / a),
                -along * (s / a) - across * (c / b),
                -along * u,
                -across * v,
                along * v * (b / a - a / b),
                self._shape,
            ]
        )
