"""The dent function (eq. 18) fitted to a deviation."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_ROUNDS = 40
_ENDED = 1e-7
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
    """

    parameters: NDArray[np.float64]
    covariance: NDArray[np.float64]

    def __call__(self, x: Field, y: Field) -> Field:
        return dent_function(self.parameters, x, y)

    @property
    def axes(self) -> tuple[float, float]:
        """Full axes, the longer first, metres."""
        a, b = 2 * np.exp(self.parameters[2:4])
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
    u, v, _, _ = _normalised(parameters, x, y)
    q = 1 - u * u - v * v
    return np.where(q > _RIM, parameters[5] * np.exp(1 - 1 / np.maximum(q, _RIM)), 0.0)


def fit_dents(
    x: Field, y: Field, depth: Field, starts: NDArray[np.float64], correlated: float
) -> list[DentModel]:
    """Fit the sum of dent functions by damped least squares (Levenberg and Marquardt).

    Parameters
    ----------
    x, y, depth : ndarray, shape (n,)
        Metres.
    starts : ndarray, shape (dents, 6)
        Parameters to begin with.
    correlated : float
        Number of points whose noise is one independent value.
    """
    parameters = starts.astype(float).copy()
    damping = 1e-3
    left = depth - _sum(parameters, x, y)
    cost = left @ left
    for _ in range(_ROUNDS):
        jacobian = np.concatenate([_jacobian(one, x, y) for one in parameters], axis=1)
        normal, gradient = jacobian.T @ jacobian, jacobian.T @ left
        diagonal = np.diag(normal)
        while True:
            damped = normal + np.diag(damping * diagonal + 1e-12 * diagonal.max())
            step = np.linalg.solve(damped, gradient).reshape(parameters.shape)
            step[:, 2:4] = np.clip(step[:, 2:4], -0.3, 0.3)
            step[:, 4] = np.clip(step[:, 4], -0.5, 0.5)
            trial = parameters + step
            left_then = depth - _sum(trial, x, y)
            cost_then = left_then @ left_then
            if cost_then <= cost or damping > 1e6:
                break
            damping *= 6
        gain = cost - cost_then
        if cost_then <= cost:
            parameters, left, cost = trial, left_then, cost_then
        damping = max(damping / 6, 1e-9)
        if gain <= _ENDED * cost:
            break
    jacobian = np.concatenate([_jacobian(one, x, y) for one in parameters], axis=1)
    variance = cost / max(len(x) - parameters.size, 1) * max(correlated, 1.0)
    scale = np.sqrt(np.maximum(np.diag(jacobian.T @ jacobian), 1e-300))
    covariance = np.linalg.pinv(jacobian.T @ jacobian / np.outer(scale, scale))
    covariance *= variance / np.outer(scale, scale)
    return [
        DentModel(one, covariance[6 * k : 6 * k + 6, 6 * k : 6 * k + 6])
        for k, one in enumerate(parameters)
    ]


def _sum(parameters, x, y):
    return sum(dent_function(one, x, y) for one in parameters)


def _normalised(parameters, x, y):
    c, s = math.cos(parameters[4]), math.sin(parameters[4])
    a, b = np.exp(np.clip(parameters[2:4], -12, 3))
    dx, dy = x - parameters[0], y - parameters[1]
    return (c * dx + s * dy) / a, (c * dy - s * dx) / b, a, b


def _jacobian(parameters, x, y):
    u, v, a, b = _normalised(parameters, x, y)
    q = np.maximum(1 - u * u - v * v, _RIM)
    shape = np.where(q > _RIM, np.exp(1 - 1 / q), 0.0)
    # Of the height with the square radius, twice.
    slope = -2 * parameters[5] * shape / (q * q)
    c, s = math.cos(parameters[4]), math.sin(parameters[4])
    return np.stack(
        [
            slope * (-u * c / a + v * s / b),
            slope * (-u * s / a - v * c / b),
            -slope * u * u,
            -slope * v * v,
            slope * u * v * (b / a - a / b),
            shape,
        ],
        axis=1,
    )
