"""Bundle adjustment of camera, projector, the pose between them, and the board in each pose.

A projector is an inverse camera: what its pixel is that lights a corner is an observation like the
camera's pixel that sees it. All are fitted at once, by robust least squares.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular
from scipy.optimize import least_squares
from scipy.sparse import diags
from scipy.sparse.linalg import LinearOperator

from ftp_dent_ros.calibration.adjustment.model import RIG, Model, rig_of, rig_vector
from ftp_dent_ros.calibration.adjustment.problem import FIRST_DEVIATIONS, Problem
from ftp_dent_ros.calibration.observing.observation import Observation
from ftp_dent_ros.rig.rig import Rig

# Residuals beyond this many standard deviations count linearly (Huber's 95 % is 1.345; corners
# that are merely blurred are to keep their say).
_ROBUST = 2.0
# Weights are standard deviations of camera and projector, found in these rounds; pixels.
_ROUNDS = 2
_RESTARTS, _FEW = 4, 10
# What the data leave open moves no farther than this makes it.
_JITTER = 1e-10


@dataclass(frozen=True, eq=False)
class Estimate:
    """A rig with all that was estimated beside it.

    Attributes
    ----------
    rig : Rig
    poses : ndarray, shape (p, 6)
        Of the board in the camera's frame: rotation vector and translation, metres.
    shape : ndarray, shape (n, 3)
        The board's corners, metres.
    deviations : tuple of two floats
        Standard deviation of a camera and of a projector coordinate, pixels.
    residuals : list of ndarray, shape (n, 4)
        Per pose: observed less modelled (u_c, v_c, u_p, v_p), pixels; NaN where not observed.
    jacobian : ndarray, shape (m, q), optional
        Of the weighted residuals, robust weights included.
    active : ndarray, shape (q,)
        Indices of the estimated parameters among all; the rig's 24 come first.
    degrees : int
        Of freedom.
    """

    rig: Rig
    poses: NDArray[np.float64]
    shape: NDArray[np.float64]
    deviations: tuple[float, float]
    residuals: list[NDArray[np.float64]]
    jacobian: NDArray[np.float64]
    active: NDArray[np.intp]
    rows_of_pose: NDArray[np.intp]
    weighted: NDArray[np.float64]

    def rms(self) -> tuple[float, float, float]:
        """Root mean square distance of camera, projector and both, pixels."""
        return rms(self.residuals)


def rms(residuals: list[NDArray[np.float64]]) -> tuple[float, float, float]:
    """Root mean square distance of camera, projector and both, pixels, as OpenCV counts it."""
    stack = np.concatenate(residuals)
    squares = [np.square(stack[:, part]).sum(axis=1) for part in (slice(0, 2), slice(2, 4))]
    known = [each[np.isfinite(each)] for each in squares]
    return (
        *(float(np.sqrt(each.mean())) if len(each) else np.nan for each in known),
        float(np.sqrt(np.concatenate(known).mean())),
    )  # type: ignore[return-value]


def adjust(
    observations: list[Observation],
    board: NDArray[np.float64],
    start: Rig,
    poses: NDArray[np.float64],
    model: Model,
    free: str = 'rig',
    shape: NDArray[np.float64] | None = None,
    deviations: tuple[float, float] | None = None,
    tolerance: float = 1e-8,
) -> Estimate:
    """Estimate rig, poses and the board's shape from observations.

    Parameters
    ----------
    observations : list of Observation
    board : ndarray, shape (n, 3)
        The board as it should be, metres.
    start : Rig
    poses : ndarray, shape (p, 6)
        Of the board, to start from.
    model : Model
    free : str
        ``rig``: all of it; ``pose``: the extrinsics alone; ``none``: the board's poses alone.
    shape : ndarray, shape (n, 3), optional
        The board's shape to start from.
    deviations : tuple of two floats, optional
        Of camera and projector; estimated if left out.
    tolerance : float
        Relative change of the sum of squares at which it ends.

    Returns
    -------
    Estimate
    """
    problem = Problem(observations, board, start, model, free, shape)
    vector = np.concatenate([rig_vector(start), poses.ravel(), problem.start_shape])
    if free == 'rig':
        vector[np.setdiff1d(np.arange(RIG), problem.active)] = 0
    estimated = deviations is None
    deviations = deviations or FIRST_DEVIATIONS
    for _ in range(_ROUNDS + 1 if estimated else 1):
        problem.deviations = deviations
        vector = _solve(problem, vector, tolerance)
        if estimated:
            deviations = problem.spread(vector)
    return _estimate(problem, vector, start, poses.shape)


def weighted_jacobian(
    seen: Observation, board: NDArray, estimate: Estimate, pose: NDArray, model: Model
) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Of one observation's residuals, and the parameters that its columns are of."""
    problem = Problem([seen], board, estimate.rig, model, 'rig', None)
    problem.deviations = estimate.deviations
    vector = np.concatenate([rig_vector(estimate.rig), pose, problem.start_shape])
    return problem.jacobian(vector[problem.active], vector).toarray(), problem.active


def _solve(problem: Problem, vector: NDArray[np.float64], tolerance: float) -> NDArray[np.float64]:
    """All parameters at the least squares."""
    for _ in range(_RESTARTS):
        vector, evaluations = _descend(problem, vector, tolerance)
        if evaluations < _FEW:
            break
    return vector


def _descend(
    problem: Problem, vector: NDArray[np.float64], tolerance: float
) -> tuple[NDArray[np.float64], int]:
    """All parameters after one descent, and how often it looked at the residuals.

    Focal lengths, distances and distortion are nearly exchangeable, on which the iterative solver
    of sparse problems stalls: it is given parameters that are uncorrelated at the start, those of
    the Cholesky factor of the normal equations.
    """
    start = vector[problem.active]
    jacobian = problem.jacobian(start, vector)
    scale = 1 / np.sqrt(np.maximum(jacobian.multiply(jacobian).sum(axis=0).A1, 1e-300))
    scaled = jacobian @ diags(scale)
    normal = (scaled.T @ scaled).toarray()
    factor = cholesky(normal + _JITTER * np.eye(len(normal)))

    def to_active(step: NDArray) -> NDArray[np.float64]:
        return start + scale * solve_triangular(factor, step)

    def jacobian_of(step: NDArray) -> LinearOperator:
        sparse = problem.jacobian(to_active(step), vector)
        return LinearOperator(
            sparse.shape,
            matvec=lambda x: sparse @ (scale * solve_triangular(factor, np.ravel(x))),
            rmatvec=lambda y: solve_triangular(factor, scale * (sparse.T @ np.ravel(y)), 'T'),
        )

    result = least_squares(
        lambda step: problem.residuals(to_active(step), vector),
        np.zeros(len(start)),
        jac=jacobian_of,
        method='trf',
        tr_solver='lsmr',
        loss='huber',
        f_scale=_ROBUST,
        xtol=1e-9,
        ftol=tolerance,
        max_nfev=30,
    )
    return problem.whole(to_active(result.x), vector), result.nfev


def _estimate(
    problem: Problem, vector: NDArray, start: Rig, shape_of_poses: tuple[int, ...]
) -> Estimate:
    """All that was estimated, of all parameters."""
    first = RIG + 6 * problem.count
    weighted = problem.residuals(vector[problem.active], vector)
    robust = np.minimum(1, np.sqrt(_ROBUST / np.maximum(np.abs(weighted), 1e-12)))
    difference = problem.observed - problem.modelled(vector)[0]
    rows_of_pose = np.broadcast_to(problem.pose_of[:, None], problem.known.shape)[problem.known]
    rows_of_pose = np.concatenate([rows_of_pose, np.full(len(weighted) - len(rows_of_pose), -1)])
    jacobian = problem.jacobian(vector[problem.active], vector).toarray() * robust[:, None]
    return Estimate(
        rig=rig_of(vector[:RIG], start),
        poses=vector[RIG:first].reshape(shape_of_poses),
        shape=problem.board + problem.give @ vector[first:],
        deviations=problem.deviations,
        residuals=np.split(difference, problem.count),
        jacobian=jacobian,
        active=problem.active,
        rows_of_pose=rows_of_pose,
        weighted=weighted * robust,
    )
