"""How well a rig is known: the covariance of its numbers, and what it makes of a depth."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.calibration.bundle import (
    RIG,
    Estimate,
    Model,
    rig_of,
    rig_vector,
    weighted_jacobian,
)
from ftp_dent_ros.calibration.observing import Observation
from ftp_dent_ros.rig.rig import Rig

# What corners may be off alike, by shading and uneven blur, pixels: twice the mean error of ray
# traced boards.
_BIAS = 0.01
_PRINCIPAL_POINTS = (2, 3, 11, 12)
# Steps of numerical derivatives: pixels, radians, metres; distortion has no unit.
_STEP = np.array(([1e-3] * 4 + [1e-5] * 5) * 2 + [1e-7] * 3 + [1e-7] * 3)


def covariance(estimate: Estimate) -> NDArray[np.float64]:
    """Covariance of the rig's 24 numbers, in the order of `calibration_record.PARAMETERS`.

    That of least squares, times the factor by which the poses' gradients scatter more than
    independent residuals would let them: what is wrong with a pose (a moved or bent board, a
    biased corner) is wrong with all its corners alike. A bias that all corners share is a shift of
    the principal points, which no residual shows: it is added. Numbers not estimated have
    variance 0.
    """
    jacobian, residuals = estimate.jacobian, estimate.weighted
    common = np.flatnonzero((estimate.active < RIG) | (estimate.active >= _first_shape(estimate)))
    count = len(estimate.poses)
    reduced, gradients = [], []
    rest = estimate.rows_of_pose < 0
    prior = jacobian[rest][:, common]
    for pose in range(count):
        rows = estimate.rows_of_pose == pose
        own = np.flatnonzero(
            (estimate.active >= RIG + 6 * pose) & (estimate.active < RIG + 6 * pose + 6)
        )
        shared, private = jacobian[rows][:, common], jacobian[rows][:, own]
        basis, _ = np.linalg.qr(private)
        shared = shared - basis @ (basis.T @ shared)
        reduced.append(shared.T @ shared)
        gradients.append(shared.T @ residuals[rows])
    total = np.sum(reduced, axis=0) + prior.T @ prior
    scale = 1 / np.sqrt(np.maximum(np.diag(total), 1e-300))
    inverse = np.linalg.pinv(total * np.outer(scale, scale), hermitian=True)
    inverse *= np.outer(scale, scale)
    freedom = max(len(residuals) - int(rest.sum()) - len(estimate.active) + prior.shape[0], 1)
    variance = float(residuals @ residuals) / freedom
    expected = sum(
        np.trace(inverse @ each) - np.trace(inverse @ each @ inverse @ each) for each in reduced
    )
    scatter = sum(float(each @ inverse @ each) for each in gradients)
    spread = max(1.0, scatter / max(variance * float(expected), 1e-300))
    result = np.zeros((RIG, RIG))
    place = estimate.active[common]
    ours = place < RIG
    result[np.ix_(place[ours], place[ours])] = (variance * spread * inverse)[np.ix_(ours, ours)]
    for index in _PRINCIPAL_POINTS:
        result[index, index] += _BIAS**2
    return result


def information(
    seen: Observation, board: NDArray, estimate: Estimate, pose: NDArray, model: Model
) -> NDArray[np.float64]:
    """What one more pose would add to the normal equations of the rig's 24 numbers."""
    jacobian, active = weighted_jacobian(seen, board, estimate, pose, model)
    basis, _ = np.linalg.qr(jacobian[:, active >= RIG])
    shared = jacobian[:, active < RIG]
    shared = shared - basis @ (basis.T @ shared)
    result = np.zeros((RIG, RIG))
    place = active[active < RIG]
    result[np.ix_(place, place)] = shared.T @ shared
    return result


def with_information(
    known: NDArray[np.float64], added: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Covariance of the rig's 24 numbers once `information` was added to a known one."""
    place = np.flatnonzero(np.diag(added) > 0)
    part = np.ix_(place, place)
    scale = np.sqrt(np.diag(known)[place])
    inverse = np.linalg.pinv(known[part] / np.outer(scale, scale), hermitian=True)
    total = inverse + added[part] * np.outer(scale, scale)
    result = np.zeros_like(known)
    result[part] = np.linalg.pinv(total, hermitian=True) * np.outer(scale, scale)
    return result


def _first_shape(estimate: Estimate) -> int:
    return RIG + 6 * len(estimate.poses)


def depths(rig: Rig, pixels: NDArray, columns: NDArray) -> NDArray[np.float64]:
    """Depth at camera pixels (n, 2) that see projector columns (n,): the flight's triangulation.

    The projector's rays of one column form a curved sheet: the row is found by iteration.
    """
    rays = rig.camera.rays(pixels)
    turned = rays @ rig.rotation.T
    row = np.full(len(rays), (rig.projector.height - 1) / 2)
    depth = np.ones(len(rays))
    for _ in range(8):
        sheet = rig.projector.rays(np.column_stack([columns, row]))
        slope = sheet[:, 0]
        depth = (slope * rig.translation[2] - rig.translation[0]) / (
            turned[:, 0] - slope * turned[:, 2]
        )
        row = rig.projector.project(depth[:, None] * turned + rig.translation)[:, 1]
    return depth


def depth_deviation(
    rig: Rig, covariance: NDArray[np.float64], pixels: NDArray, distance: NDArray
) -> NDArray[np.float64]:
    """Standard deviation of the depth that the rig's covariance makes, metres.

    Parameters
    ----------
    rig : Rig
    covariance : ndarray, shape (24, 24)
    pixels : ndarray, shape (n, 2)
        Camera pixels.
    distance : ndarray, shape (n,)
        Depths, metres.

    Returns
    -------
    ndarray, shape (n,)
    """
    slopes = depth_slopes(rig, pixels, distance)
    return np.sqrt(((slopes @ covariance) * slopes).sum(axis=1))


def depth_slopes(rig: Rig, pixels: NDArray, distance: NDArray) -> NDArray[np.float64]:
    """Change of depths (n,) with the rig's numbers, shape (n, 24), at camera pixels (n, 2)."""
    points = rig.camera.rays(pixels) * np.asarray(distance)[:, None]
    columns = rig.projector.project(rig.to_projector(points))[:, 0]
    vector = rig_vector(rig)
    slopes = np.zeros((len(points), RIG))
    for index in range(RIG):
        step = np.zeros(RIG)
        step[index] = _STEP[index]
        ends = [depths(rig_of(vector + sign * step, rig), pixels, columns) for sign in (-1, 1)]
        slopes[:, index] = (ends[1] - ends[0]) / (2 * _STEP[index])
    return slopes
