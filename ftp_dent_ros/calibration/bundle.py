"""Bundle adjustment of a rig and of the board in each pose, and how well it is known then.

A projector is an inverse camera: what its pixel is that lights a corner is an observation like the
camera's pixel that sees it. All are fitted at once, by robust least squares.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ftp_dent_ros.calibration.descent import descend
from ftp_dent_ros.calibration.observing import Observation
from ftp_dent_ros.rig.rig import Lens, Rig
from ftp_dent_ros.robust import deviation

# Coefficients k1, k2, p1, p2, k3 as they come in, one candidate after the other.
DISTORTIONS: tuple[tuple[int, ...], ...] = ((), (0,), (0, 1), (0, 1, 2, 3), (0, 1, 2, 3, 4))
# Numbers of a lens; of a rig: two lenses, a rotation vector and a translation; and with the
# board's bend, that of all poses.
LENS = 9
RIG = 2 * LENS + 6
_COMMON = RIG + 3
_EXTRINSICS = slice(2 * LENS, RIG)
# Where the two lenses are in a rig's numbers, and their pixels in an observation's.
_LENSES = ((slice(0, LENS), slice(0, 2)), (slice(LENS, 2 * LENS), slice(2, 4)))

# Before anything is known, pixels, standard deviation of camera and projector; and at best.
_FIRST_DEVIATIONS, _BEST = (0.3, 0.3), 0.005

# Residuals beyond this many standard deviations count linearly (Huber's 95 % is 1.345; corners
# that are merely blurred are to keep their say).
_ROBUST = 2.0
# Steps of the adjustment at most, and those of the search for a depth.
_STEPS, _NEWTON = 100, 5

# What corners may be off alike, by shading and uneven blur, pixels: twice the mean error of ray
# traced boards.
_BIAS = 0.01
_PRINCIPAL_POINTS = (2, 3, 11, 12)
# Steps of numerical derivatives: pixels, radians, metres; distortion has no unit.
_STEP = np.array(([1e-3] * 4 + [1e-5] * 5) * 2 + [1e-7] * 6)


@dataclass(frozen=True)
class Model:
    """What is estimated.

    Attributes
    ----------
    camera, projector : int
        Index into `DISTORTIONS`.
    bent : bool
        Whether the board is a quadratic, not a plane.
    """

    camera: int = len(DISTORTIONS) - 1
    projector: int = len(DISTORTIONS) - 1
    bent: bool = False


@dataclass(frozen=True, eq=False)
class Adjustment:
    """A rig with all that was estimated beside it, and what it was estimated from.

    Attributes
    ----------
    observations : list of Observation
    board : ndarray, shape (n, 3)
        The corners as they should be, metres.
    rig : Rig
    poses : ndarray, shape (p, 6)
        Of the board in the camera's frame, an observation each: rotation vector and translation,
        metres.
    bend : ndarray, shape (3,)
        Of the board: metres of x^2, x y and y^2, which reach from -1 to 1.
    deviations : tuple of two floats, optional
        Standard deviation of a camera and of a projector coordinate, pixels.
    residuals : ndarray, shape (p, n, 4)
        Observed less modelled (u_c, v_c, u_p, v_p), pixels; NaN where not observed.
    """

    observations: list[Observation]
    board: NDArray[np.float64]
    rig: Rig
    poses: NDArray[np.float64]
    bend: NDArray[np.float64]
    deviations: tuple[float, float] | None = None
    residuals: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 0, 4)))

    @property
    def observed(self) -> NDArray[np.float64]:
        """Pixels (u_c, v_c, u_p, v_p) of the corners, shape (p, n, 4); NaN where not observed."""
        return np.stack([np.hstack([o.camera, o.projector]) for o in self.observations])

    def rms(self) -> tuple[float, float, float]:
        """Root mean square distance of camera, projector and both, pixels."""
        return rms(self.residuals)

    def points(self) -> NDArray[np.float64]:
        """The corners in the camera's frame, shape (p, n, 3), metres."""
        corners = self.board + bend_terms(self.board) @ self.bend
        turns = Rotation.from_rotvec(self.poses[:, :3]).as_matrix()
        return corners @ turns.transpose(0, 2, 1) + self.poses[:, None, 3:]

    def of_poses(self, which: NDArray) -> Adjustment:
        """The same, of some poses alone."""
        seen = [self.observations[index] for index in which]
        return replace(self, observations=seen, poses=self.poses[which])


def rms(residuals: NDArray[np.float64]) -> tuple[float, float, float]:
    """Root mean square distance of camera, projector and both, pixels, as OpenCV counts it."""
    squares = np.square(residuals.reshape(-1, 2, 2)).sum(axis=-1).T
    known = (each[np.isfinite(each)] for each in (*squares, squares))
    camera, projector, both = (np.sqrt(each.mean()) if len(each) else np.nan for each in known)
    return float(camera), float(projector), float(both)


def rig_vector(rig: Rig) -> NDArray[np.float64]:
    """The rig's 24 numbers, in the order of `calibration_record.PARAMETERS`."""
    lenses = [
        np.concatenate([lens.camera_matrix[[0, 1, 0, 1], [0, 1, 2, 2]], lens.distortion])
        for lens in (rig.camera, rig.projector)
    ]
    turn = Rotation.from_matrix(rig.rotation).as_rotvec()
    return np.concatenate([*lenses, turn, rig.translation])


def rig_of(vector: NDArray, like: Rig) -> Rig:
    """The rig of its 24 numbers, with image sizes `like` another's."""
    camera, projector = (
        Lens(lens.width, lens.height, _matrix(vector[part]), vector[part][4:].copy())
        for lens, (part, _) in zip((like.camera, like.projector), _LENSES, strict=True)
    )
    rotation = Rotation.from_rotvec(vector[18:21]).as_matrix()
    return Rig(camera, projector, rotation, vector[21:RIG].copy())


def _matrix(lens: NDArray) -> NDArray[np.float64]:
    return np.array([[lens[0], 0, lens[2]], [0, lens[1], lens[3]], [0, 0, 1]])


def bend_terms(board: NDArray) -> NDArray[np.float64]:
    """Derivatives of a board's corners by its bend, shape (n, 3, 3)."""
    place = board[:, :2] - board[:, :2].mean(axis=0)
    x, y = (place / np.abs(place).max(axis=0)).T
    by = np.zeros((len(board), 3, 3))
    by[:, 2] = np.stack([x * x, x * y, y * y], axis=1)
    return by


def _composed(*motions: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Rotation vector and translation of two motions, and their derivatives, shape (6, 12)."""
    turn, shift, *by = cv2.composeRT(*motions)
    return turn, shift, np.block([by[:4], by[4:]])


class _Problem:
    """Observations, and what of all numbers (rig, bend, poses) is to be estimated from them."""

    def __init__(self, start: Adjustment, model: Model | None) -> None:
        self.start = start
        self.observed = start.observed
        self.known = np.isfinite(self.observed)
        self.deviations = start.deviations or _FIRST_DEVIATIONS
        self.vector = np.concatenate([rig_vector(start.rig), start.bend, start.poses.ravel()])
        self.active = np.arange(len(self.vector)) >= _COMMON
        if model is None:
            return
        self.active[2 * LENS : RIG] = True
        self.active[RIG:_COMMON] = model.bent
        for (part, _), terms in zip(_LENSES, (model.camera, model.projector), strict=True):
            self.active[part.start : part.start + 4] = True
            self.active[[part.start + 4 + index for index in DISTORTIONS[terms]]] = True
        self.vector[~self.active] = 0

    def modelled(self, vector: NDArray) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Pixels (p, n, 4) of every corner, and their derivatives by all numbers."""
        bending = bend_terms(self.start.board)
        corners = self.start.board + bending @ vector[RIG:_COMMON]
        pixels = np.empty(self.observed.shape)
        slopes = np.zeros((*pixels.shape, len(vector)))
        for index in range(len(pixels)):
            pose = slice(_COMMON + 6 * index, _COMMON + 6 * index + 6)
            turn, shift = np.split(vector[pose], 2)
            *in_projector, by = _composed(turn, shift, *np.split(vector[_EXTRINSICS], 2))
            motions = (turn, shift, np.eye(6, 12)), (*in_projector, by)
            for (part, place), (turn, shift, by_motion) in zip(_LENSES, motions, strict=True):
                lens = vector[part]
                pixel, by = cv2.projectPoints(corners, turn, shift, _matrix(lens), lens[4:])[:2]
                by = np.reshape(by, (len(corners), 2, -1))
                pixels[index, :, place] = np.reshape(pixel, (-1, 2))
                slope = slopes[index, :, place]
                slope[..., pose], slope[..., _EXTRINSICS] = np.split(
                    by[..., :6] @ by_motion, 2, -1
                )
                slope[..., RIG:_COMMON] = by[..., 3:6] @ cv2.Rodrigues(turn)[0] @ bending
                slope[..., part] = by[..., 6:]
        return pixels, slopes

    def weighted(self, vector: NDArray) -> tuple[NDArray, NDArray, float]:
        """Residuals (m,) in standard deviations, derivatives by what is estimated, Huber's cost.

        Both are times the square root of Huber's weight; 0 where nothing was observed.
        """
        pixels, slopes = self.modelled(vector)
        each = np.repeat(self.deviations, 2)
        residuals = np.where(self.known, (pixels - self.observed) / each, 0)
        size = np.abs(residuals)
        cost = np.where(size < _ROBUST, size**2, _ROBUST * (2 * size - _ROBUST)).sum()
        weight = self.known * np.sqrt(_ROBUST / np.maximum(size, _ROBUST))
        jacobian = slopes[..., self.active] * (weight / each)[..., None]
        return (residuals * weight).ravel(), jacobian.reshape(residuals.size, -1), float(cost)

    def solved(self, tolerance: float) -> NDArray[np.float64]:
        """All numbers at the least squares."""

        def linearised(state: NDArray) -> tuple[NDArray, NDArray, NDArray]:
            vector = self.vector.copy()
            vector[self.active] = state[0]
            residuals, jacobian, cost = self.weighted(vector)
            return np.array([cost]), (jacobian.T @ residuals)[None], (jacobian.T @ jacobian)[None]

        vector = self.vector.copy()
        vector[self.active] = descend(linearised, vector[None, self.active], tolerance, _STEPS)[0]
        return vector

    def spread(self) -> tuple[float, float]:
        """Robust standard deviation of camera and projector coordinates, pixels."""
        off = self.modelled(self.vector)[0] - self.observed
        left = max(1 - self.active.sum() / max(int(self.known.sum()), 1), 0.1)
        camera, projector = (
            max(_BEST, deviation(off[..., place][self.known[..., place]]) / float(np.sqrt(left)))
            for _, place in _LENSES
        )
        return camera, projector

    def beyond_poses(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Weighted residuals, and what of the common numbers' derivatives no pose undoes."""
        residuals, jacobian, _ = self.weighted(self.vector)
        common = int(self.active[:_COMMON].sum())
        basis, _ = np.linalg.qr(jacobian[:, common:])
        shared = jacobian[:, :common]
        return residuals, shared - basis @ (basis.T @ shared)


def adjust(start: Adjustment, model: Model | None, tolerance: float = 1e-8) -> Adjustment:
    """Estimate rig, poses and the board's bend from observations.

    Parameters
    ----------
    start : Adjustment
        Its standard deviations are the weights; they are estimated if it has none.
    model : Model, optional
        None: the board's poses alone are estimated.
    tolerance : float
        Relative change of the sum of squares at which it ends.
    """
    problem = _Problem(start, model)
    # Weights are found in these rounds.
    for _ in range(1 if start.deviations else 3):
        problem.vector = vector = problem.solved(tolerance)
        if start.deviations is None:
            problem.deviations = problem.spread()
    return replace(
        start,
        rig=rig_of(vector, start.rig),
        poses=vector[_COMMON:].reshape(-1, 6),
        bend=vector[RIG:_COMMON],
        deviations=problem.deviations,
        residuals=problem.observed - problem.modelled(vector)[0],
    )


def inverse_of(normal: NDArray[np.float64]) -> NDArray[np.float64]:
    """Pseudoinverse of a normal matrix, whatever the units of its unknowns."""
    scale = 1 / np.sqrt(np.maximum(np.diag(normal), 1e-300))
    units = np.outer(scale, scale)
    return np.linalg.pinv(normal * units, hermitian=True) * units


def covariance(estimate: Adjustment, model: Model) -> NDArray[np.float64]:
    """Covariance of the rig's 24 numbers, in the order of `calibration_record.PARAMETERS`.

    That of least squares, times the factor by which the poses' gradients scatter more than
    independent residuals would let them: what is wrong with a pose (a moved or bent board, a
    biased corner) is wrong with all its corners alike. A bias that all corners share is a shift of
    the principal points, which no residual shows: it is added. Numbers not estimated have
    variance 0.
    """
    problem = _Problem(estimate, model)
    residuals, shared = problem.beyond_poses()
    by_pose = shared.reshape(len(estimate.poses), -1, shared.shape[1])
    reduced = by_pose.transpose(0, 2, 1) @ by_pose
    gradients = np.einsum('pmk,pm->pk', by_pose, residuals.reshape(len(by_pose), -1))
    total = reduced.sum(axis=0)
    inverse = inverse_of(total)
    freedom = max(int(problem.known.sum() - problem.active.sum()), 1)
    variance = float(residuals @ residuals) / freedom
    own = inverse @ reduced
    expected = np.einsum('pii->', own) - np.einsum('pij,pji->', own, own)
    scatter = np.einsum('pi,ij,pj->', gradients, inverse, gradients)
    spread = max(1.0, float(scatter) / max(variance * float(expected), 1e-300))
    active = problem.active[:_COMMON]
    result = np.zeros((_COMMON, _COMMON))
    result[np.ix_(active, active)] = variance * spread * inverse
    result[_PRINCIPAL_POINTS, _PRINCIPAL_POINTS] += _BIAS**2
    return result[:RIG, :RIG]


def with_pose(known: NDArray[np.float64], more: Adjustment, model: Model) -> NDArray[np.float64]:
    """Covariance of the rig's 24 numbers, beside a known one, once one pose more was seen."""
    problem = _Problem(more, model)
    _, shared = problem.beyond_poses()
    slopes = np.zeros((len(shared), RIG))
    slopes[:, problem.active[:RIG]] = shared
    # Kalman's update.
    tells = slopes @ known
    return known - tells.T @ np.linalg.solve(np.eye(len(slopes)) + tells @ slopes.T, tells)


def depths(rig: Rig, pixels: NDArray, columns: NDArray) -> NDArray[np.float64]:
    """Depth at camera pixels (n, 2) that see projector columns (n,): the flight did it."""
    return depths_along(rig, rig.camera.rays(pixels), columns)


def depths_along(rig: Rig, rays: NDArray, columns: NDArray) -> NDArray[np.float64]:
    """Depth along the camera's rays (n, 3) that see projector columns (n,).

    The projector's rays of one column form a sheet. Where it is taken as flat the search begins,
    by the inverse depth, in which a column is nearly linear.
    """
    rays, shift = rays @ rig.rotation.T, rig.translation
    middle = np.full(len(rays), (rig.projector.height - 1) / 2)
    slope = rig.projector.rays(np.column_stack([columns, middle]))[:, 0]
    inverse = (rays[:, 0] - slope * rays[:, 2]) / (slope * shift[2] - shift[0])
    step = 1e-4
    for _ in range(_NEWTON):
        here, beyond = (
            rig.projector.project(rays + at[:, None] * shift)[:, 0]
            for at in (inverse, inverse + step)
        )
        inverse = inverse + step * (columns - here) / (beyond - here)
    return 1 / inverse


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
    for index, step in enumerate(np.diag(_STEP)):
        below, above = (depths(rig_of(vector + by, rig), pixels, columns) for by in (-step, step))
        slopes[:, index] = (above - below) / (2 * _STEP[index])
    return slopes
