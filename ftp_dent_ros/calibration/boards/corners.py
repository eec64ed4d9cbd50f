"""Where squares meet, to a few hundredths of a pixel: a model of two blurred edges is fitted."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

# Levenberg and Marquardt's damping: first, and its factor from step to step.
_DAMPING, _FACTOR = 1e-2, 10.0
_STEPS = 25
_CONVERGED = 1e-4
# A fit that wanders this far has found something else, pixels.
_FARTHEST = 3.0
# Edges of a photograph in focus are at least this soft: a pixel is a square, pixels.
_SHARPEST = 0.25


def refine_corners(
    image: NDArray,
    corners: NDArray[np.float64],
    along: NDArray[np.float64],
    radius: int,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Fit two crossing edges about each corner.

    What is seen is ``o + g_x x + g_y y + a erf(s_1) erf(s_2)``, where s_i are the distances to
    the two edges over sqrt(2) times the blur, in even light.

    Parameters
    ----------
    image : ndarray, shape (height, width)
        Grey.
    corners : ndarray, shape (n, 2)
        To within a pixel or two.
    along : ndarray, shape (n, 2, 2)
        Directions of the two edges.
    radius : int
        Of the window, pixels.

    Returns
    -------
    corners : ndarray, shape (n, 2)
        NaN where no such crossing is found.
    blur : ndarray, shape (n,)
        Standard deviation of the edges' blur, pixels.
    """
    height, width = image.shape
    whole = np.rint(corners).astype(int)
    inside = ((whole >= radius) & (whole < np.array([width, height]) - radius)).all(axis=1)
    whole[~inside] = radius
    offset = np.arange(-radius, radius + 1)
    rows, columns = whole[:, 1, None, None] + offset[:, None], whole[:, 0, None, None] + offset
    values = image[rows, columns].reshape(len(corners), -1).astype(float)
    x, y = (part.ravel().astype(float) for part in np.meshgrid(offset, offset))
    near = np.hypot(x, y) <= radius + 0.5
    x, y, values = x[near], y[near], values[:, near]
    angles = np.arctan2(along[..., 0], -along[..., 1])  # of the edges' normals
    state = np.zeros((len(corners), 9))
    state[:, :2] = corners - whole
    state[:, 2:4], state[:, 4] = angles, 1.0
    state[:, 5:] = _light(state, x, y, values)
    state = _fit(state, x, y, values)
    moved = np.linalg.norm(state[:, :2] + whole - corners, axis=1)
    lost = ~inside | (moved > _FARTHEST) | (state[:, 4] > radius / 2)
    found = whole + state[:, :2]
    found[lost] = np.nan
    return found, np.where(lost, np.nan, state[:, 4])


def _fit(state: NDArray, x: NDArray, y: NDArray, values: NDArray) -> NDArray[np.float64]:
    damping = np.full(len(state), _DAMPING)
    model, jacobian = _model(state, x, y)
    cost = np.square(values - model).sum(axis=1)
    for _ in range(_STEPS):
        turned = jacobian.transpose(0, 2, 1)
        normal = turned @ jacobian
        gradient = (turned @ (values - model)[..., None])[..., 0]
        diagonal = np.einsum('nii->ni', normal)
        damped = normal + (damping[:, None] * diagonal + 1e-9)[:, :, None] * np.eye(9)
        step = np.linalg.solve(damped, gradient[..., None])[..., 0]
        tried = state + step
        tried[:, 4] = np.maximum(tried[:, 4], _SHARPEST)
        new_model, new_jacobian = _model(tried, x, y)
        new_cost = np.square(values - new_model).sum(axis=1)
        better = new_cost < cost
        state = np.where(better[:, None], tried, state)
        model = np.where(better[:, None], new_model, model)
        jacobian = np.where(better[:, None, None], new_jacobian, jacobian)
        cost = np.where(better, new_cost, cost)
        damping = np.clip(np.where(better, damping / _FACTOR, damping * _FACTOR), 1e-9, 1e9)
        if np.abs(step[:, :2]).max() < _CONVERGED:
            break
    return state


def _light(state: NDArray, x: NDArray, y: NDArray, values: NDArray) -> NDArray[np.float64]:
    """Offset, slopes and contrast to start from, by linear least squares."""
    _, jacobian = _model(state, x, y)
    linear = jacobian[..., 5:]
    turned = linear.transpose(0, 2, 1)
    normal = turned @ linear + 1e-9 * np.eye(4)
    return np.linalg.solve(normal, turned @ values[..., None])[..., 0]


def _model(state: NDArray, x: NDArray, y: NDArray) -> tuple[NDArray, NDArray]:
    """Light in the windows, shape (n, m), and its derivatives, shape (n, m, 9)."""
    cx, cy, first, second, blur, offset, slope_x, slope_y, contrast = state.T[..., None]
    dx, dy = x - cx, y - cy
    width = np.sqrt(2) * blur
    edges, slopes, turns = [], [], []
    for angle in (first, second):
        distance = (np.cos(angle) * dx + np.sin(angle) * dy) / width
        edges.append(erf(distance))
        slopes.append(2 / np.sqrt(np.pi) * np.exp(-distance * distance))
        turns.append((distance, (np.cos(angle) * dy - np.sin(angle) * dx) / width))
    by_first, by_second = slopes[0] * edges[1], slopes[1] * edges[0]
    jacobian = np.empty((len(state), len(x), 9))
    jacobian[..., 0] = -contrast * (by_first * np.cos(first) + by_second * np.cos(second)) / width
    jacobian[..., 1] = -contrast * (by_first * np.sin(first) + by_second * np.sin(second)) / width
    jacobian[..., 2] = contrast * by_first * turns[0][1]
    jacobian[..., 3] = contrast * by_second * turns[1][1]
    jacobian[..., 4] = -contrast * (by_first * turns[0][0] + by_second * turns[1][0]) / blur
    jacobian[..., 5] = 1
    jacobian[..., 6], jacobian[..., 7] = x, y
    jacobian[..., 8] = edges[0] * edges[1]
    light = offset + slope_x * x + slope_y * y + contrast * jacobian[..., 8]
    return light, jacobian
