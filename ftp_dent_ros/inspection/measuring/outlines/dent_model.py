"""The dent function (eq. 18) fitted to a deviation."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.inspection.measuring.skin.equations import solved

# Of Levenberg and Marquardt, at most.
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


def dent_function(parameters: NDArray, x: Field, y: Field) -> Field:
    """Eq. 18 at x, y, for the parameters of `DentModel`."""
    places = np.stack([np.ravel(x), np.ravel(y)])
    return _Function(parameters, places).depth.reshape(np.shape(x))


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
    places, data = np.stack([x[known], y[known]]), depth[known]
    function = _Function(shape, places)
    left = data - function.depth
    cost = left @ left
    ended = False
    for _ in range(_ROUNDS):
        normal, gradient = function.normal_equations(left)
        diagonal = normal.diagonal().copy()
        # A dent that has left the grid has no slopes, and stays where it is.
        diagonal[diagonal <= 0] = 1
        while True:
            damped = normal.copy()
            damped.flat[:: len(damped) + 1] += (damping + 1e-12) * diagonal
            change = solved(damped, gradient)
            trial = shape + np.minimum(np.maximum(change, -_STRIDES), _STRIDES)
            function_then = _Function(trial, places)
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
    normal, _ = function.normal_equations(left)
    together = max(correlated, 1.0)
    if together > _HIDDEN:
        together = min(together, _HIDDEN * _correlated_cells(left, known))
    variance = together * cost / max(len(data) - len(shape), 1)
    inverse, is_regular = _inverse(normal)
    covariance = variance * inverse
    finite = bool(np.isfinite(shape).all() and np.isfinite(covariance).all())
    return DentModel(shape, covariance, ended and is_regular and finite)


def _inverse(normal: Field) -> tuple[Field, bool]:
    """Inverse of a normal matrix, and whether it has one.

    What it does not determine is left very uncertain.
    """
    scale = np.sqrt(np.maximum(normal.diagonal(), 1e-30))
    together = scale * scale[:, None]
    values, vectors = np.linalg.eigh(normal / together)
    inverse = (vectors / np.maximum(values, _SINGULAR)) @ vectors.T
    # The angle of what is round is free, and nothing else may be.
    regular = bool((normal.diagonal() > 0)[[0, 1, 2, 3, 5]].all())
    return inverse / together, regular and int((values < _SINGULAR).sum()) < 2


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
    """Eq. 18 at some places, and what its slopes along the parameters share with it.

    In the ellipse's own coordinates u and v, in which it is the unit circle.
    """

    def __init__(self, parameters: Field, places: Field) -> None:
        x, y, first, second, angle, self._depth = parameters.tolist()
        a, b = math.exp(min(max(first, -12), 3)), math.exp(min(max(second, -12), 3))
        c, s = math.cos(angle), math.sin(angle)
        turned = np.array([[c / a, s / a], [-s / b, c / b]])
        self._uv = turned @ (places - np.array([[x], [y]]))
        self._square = self._uv * self._uv
        inside = 1 - self._square[0] - self._square[1]
        self._q = np.maximum(inside, _RIM)
        self._shape = np.exp(1 - 1 / self._q)
        self._shape[inside <= _RIM] = 0
        self._turned, self._oval = turned, b / a - a / b

    @property
    def depth(self) -> Field:
        """Depths, metres, shape (places,)."""
        return self._depth * self._shape

    def normal_equations(self, left: Field) -> tuple[Field, Field]:
        """J J^T, shape (6, 6), and J left, of the depths' derivatives J along the parameters."""
        u, v = self._uv
        found = np.empty((6, len(u)))
        # Of the height with the square radius, twice.
        slope = -2 * self._depth * self._shape / (self._q * self._q)
        np.multiply(slope, self._uv, out=found[:2])
        np.multiply(slope, self._square, out=found[2:4])
        np.multiply(found[0], v, out=found[4])
        found[5] = self._shape
        # Those of the parameters from those along u, v, u^2, v^2, uv, and the shape.
        change = np.zeros((6, 6))
        change[:2, :2] = -self._turned.T
        change[2, 2] = change[3, 3] = -1
        change[4, 4], change[5, 5] = self._oval, 1
        return change @ (found @ found.T) @ change.T, change @ (found @ left)
