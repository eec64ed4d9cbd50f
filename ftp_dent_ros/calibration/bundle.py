"""Bundle adjustment of a rig and of the board in each pose, and how well it is known then.

A projector is an inverse camera: what its pixel is that lights a corner is an observation like the
camera's pixel that sees it. All are fitted at once, by robust least squares.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular
from scipy.optimize import least_squares
from scipy.sparse import csr_matrix, diags
from scipy.sparse.linalg import LinearOperator
from scipy.spatial.transform import Rotation

from ftp_dent_ros.calibration.observing import Observation
from ftp_dent_ros.rig.rig import Lens, Rig
from ftp_dent_ros.robust import NORMAL_SPREAD

# Coefficients k1, k2, p1, p2, k3 as they come in, one candidate after the other.
DISTORTIONS: tuple[tuple[int, ...], ...] = ((), (0,), (0, 1), (0, 1, 2, 3), (0, 1, 2, 3, 4))
SHAPES = ('flat', 'bent', 'free')
# Numbers of a lens, and of a rig: two lenses, a rotation vector and a translation.
LENS = 9
RIG = 2 * LENS + 6

# What a print or a plate may be off without being another board; metres, standard deviation.
_FREEDOM = 0.0003
# Before anything is known, pixels, standard deviation of camera and projector.
FIRST_DEVIATIONS = (0.3, 0.3)

# Residuals beyond this many standard deviations count linearly (Huber's 95 % is 1.345; corners
# that are merely blurred are to keep their say).
_ROBUST = 2.0

# What corners may be off alike, by shading and uneven blur, pixels: twice the mean error of ray
# traced boards.
_BIAS = 0.01
_PRINCIPAL_POINTS = (2, 3, 11, 12)
# Steps of numerical derivatives: pixels, radians, metres; distortion has no unit.
_STEP = np.array(([1e-3] * 4 + [1e-5] * 5) * 2 + [1e-7] * 3 + [1e-7] * 3)


@dataclass(frozen=True)
class Model:
    """What is estimated.

    Attributes
    ----------
    camera, projector : int
        Index into `DISTORTIONS`.
    shape : str
        Of the board: one of `SHAPES`. ``bent`` is a quadratic, ``free`` lets each corner move.
    """

    camera: int = len(DISTORTIONS) - 1
    projector: int = len(DISTORTIONS) - 1
    shape: str = 'flat'


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
    lenses = []
    for lens, part in ((like.camera, vector[:LENS]), (like.projector, vector[LENS : 2 * LENS])):
        matrix = np.array([[part[0], 0, part[2]], [0, part[1], part[3]], [0, 0, 1]])
        lenses.append(Lens(lens.width, lens.height, matrix, part[4:].copy()))
    rotation = Rotation.from_rotvec(vector[18:21]).as_matrix()
    return Rig(lenses[0], lenses[1], rotation, vector[21:24].copy())


def project(points: NDArray, lens: NDArray):
    """Pixels, and their derivatives by the points (n, 2, 3) and the lens's numbers (n, 2, 9)."""
    fx, fy, cx, cy, k1, k2, p1, p2, k3 = lens
    z = points[:, 2]
    x, y = points[:, 0] / z, points[:, 1] / z
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    slope = 2 * (k1 + r2 * (2 * k2 + 3 * r2 * k3))
    xd = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    yd = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    pixel = np.stack([fx * xd + cx, fy * yd + cy], axis=1)
    mixed = x * y * slope + 2 * p1 * x + 2 * p2 * y
    xx = fx * (radial + x * x * slope + 2 * p1 * y + 6 * p2 * x)
    yy = fy * (radial + y * y * slope + 6 * p1 * y + 2 * p2 * x)
    by_point = np.empty((len(z), 2, 3))
    by_point[:, 0, 0], by_point[:, 0, 1] = xx / z, fx * mixed / z
    by_point[:, 1, 0], by_point[:, 1, 1] = fy * mixed / z, yy / z
    by_point[:, :, 2] = -(by_point[:, :, 0] * x[:, None] + by_point[:, :, 1] * y[:, None])
    by_lens = np.zeros((len(z), 2, LENS))
    by_lens[:, 0, 0], by_lens[:, 1, 1] = xd, yd
    by_lens[:, 0, 2] = by_lens[:, 1, 3] = 1
    for index, power in ((4, r2), (5, r2 * r2), (8, r2**3)):
        by_lens[:, 0, index], by_lens[:, 1, index] = fx * x * power, fy * y * power
    by_lens[:, 0, 6], by_lens[:, 1, 6] = 2 * fx * x * y, fy * (r2 + 2 * y * y)
    by_lens[:, 0, 7], by_lens[:, 1, 7] = fx * (r2 + 2 * x * x), 2 * fy * x * y
    return pixel, by_point, by_lens


def cross_matrices(vectors: NDArray) -> NDArray[np.float64]:
    """Matrices of the cross product with vectors of shape (n, 3)."""
    matrices = np.zeros((len(vectors), 3, 3))
    x, y, z = vectors.T
    matrices[:, 0, 1], matrices[:, 0, 2] = -z, y
    matrices[:, 1, 0], matrices[:, 1, 2] = z, -x
    matrices[:, 2, 0], matrices[:, 2, 1] = -y, x
    return matrices


def left_jacobian(rotation: NDArray) -> NDArray[np.float64]:
    """Change of the turned frame with a rotation vector: the left Jacobian of SO(3)."""
    angle = float(np.linalg.norm(rotation))
    cross = cross_matrices(rotation[None])[0]
    if angle < 1e-5:
        return np.eye(3) + cross / 2
    first = (1 - np.cos(angle)) / angle**2
    second = (angle - np.sin(angle)) / angle**3
    return np.eye(3) + first * cross + second * cross @ cross


class Problem:
    """Residuals and their sparse Jacobian over the active ones of all parameters."""

    def __init__(
        self,
        observations: list[Observation],
        board: NDArray[np.float64],
        start: Rig,
        model: Model,
        free: str,
        shape: NDArray[np.float64] | None,
    ) -> None:
        self.board = board
        self.count = len(observations)
        self.observed = np.concatenate([np.hstack([o.camera, o.projector]) for o in observations])
        self.pose_of = np.repeat(np.arange(self.count), len(board))
        self.corner_of = np.tile(np.arange(len(board)), self.count)
        self.known = np.isfinite(self.observed)
        self.deviations = FIRST_DEVIATIONS
        self.model = model
        half = np.abs(board[:, :2] - board[:, :2].mean(axis=0)).max(axis=0)
        x, y = ((board[:, :2] - board[:, :2].mean(axis=0)) / half).T
        terms = {'flat': 0, 'bent': 3, 'free': board.size}[model.shape]
        # d corner / d shape parameter, shape (n, 3, terms).
        self.give = np.zeros((len(board), 3, terms))
        if model.shape == 'bent':
            self.give[:, 2] = np.stack([x * x, x * y, y * y], axis=1)
        elif model.shape == 'free':
            self.give[:] = np.eye(board.size).reshape(len(board), 3, board.size)
        self.start_shape: NDArray[np.floating] = np.zeros(terms)
        if shape is not None and terms:
            flat = self.give.reshape(-1, terms)
            self.start_shape = np.linalg.lstsq(flat, (shape - board).ravel(), rcond=None)[0]
        elif shape is not None:
            self.board = shape
        active: list[int] = []
        if free == 'rig':
            for offset, terms_of in ((0, model.camera), (LENS, model.projector)):
                active += [offset + i for i in range(4)]
                active += [offset + 4 + i for i in DISTORTIONS[terms_of]]
        if free in ('rig', 'pose'):
            active += range(18, 24)
        active += range(RIG, RIG + 6 * self.count)
        first = RIG + 6 * self.count
        if free == 'rig':
            active += range(first, first + terms)
        self.active = np.array(active)
        self.place = np.full(first + terms, -1)
        self.place[self.active] = np.arange(len(self.active))

    def whole(self, active: NDArray, vector: NDArray) -> NDArray[np.float64]:
        """All parameters: those of `vector`, the active ones replaced."""
        whole = vector.copy()
        whole[self.active] = active
        return whole

    def residuals(self, active: NDArray, vector: NDArray) -> NDArray[np.float64]:
        """Modelled less observed coordinates in standard deviations, then what is known before."""
        whole = self.whole(active, vector)
        difference = self.modelled(whole)[0] - self.observed
        weighted = (difference / np.repeat(self.deviations, 2))[self.known]
        if self.model.shape == 'free':
            weighted = np.concatenate([weighted, whole[RIG + 6 * self.count :] / _FREEDOM])
        return weighted

    def jacobian(self, active: NDArray, vector: NDArray) -> csr_matrix:
        """Derivatives of `residuals` by the active parameters."""
        whole = self.whole(active, vector)
        _, parts = self.modelled(whole, derivatives=True)
        row_of = np.full(self.known.shape, -1)
        row_of[self.known] = np.arange(self.known.sum())
        rows, columns, values = [], [], []
        for components, indices, derivative in parts:
            # derivative: (observations, 2, k), indices: (observations, k)
            scale = 1 / self.deviations[components.start // 2]
            row = np.broadcast_to(row_of[:, components, None], derivative.shape)
            column = np.broadcast_to(self.place[indices][:, None], derivative.shape)
            kept = (row >= 0) & (column >= 0) & (derivative != 0)
            rows.append(row[kept])
            columns.append(column[kept])
            values.append(derivative[kept] * scale)
        height = int(self.known.sum())
        if self.model.shape == 'free':
            place = self.place[RIG + 6 * self.count :]
            kept_places = place >= 0
            rows.append(height + np.flatnonzero(kept_places))
            columns.append(place[kept_places])
            values.append(np.full(kept_places.sum(), 1 / _FREEDOM))
            height += len(place)
        entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
        return csr_matrix(entries, shape=(height, len(self.active)))

    def modelled(self, whole: NDArray, derivatives: bool = False):
        """Pixels of every corner in every pose, shape (poses * n, 4), and their derivatives."""
        first = RIG + 6 * self.count
        corners = self.board + self.give @ whole[first:]
        poses = whole[RIG:first].reshape(-1, 6)
        turns = Rotation.from_rotvec(poses[:, :3]).as_matrix()
        turned = np.einsum('pij,nj->pni', turns, corners).reshape(-1, 3)
        in_camera = turned + poses[self.pose_of, 3:]
        rig_turn = Rotation.from_rotvec(whole[18:21]).as_matrix()
        rig_turned = in_camera @ rig_turn.T
        in_projector = rig_turned + whole[21:24]
        pixels = np.empty((len(turned), 4))
        parts = []
        for points, offset, components in (
            (in_camera, 0, slice(0, 2)),
            (in_projector, LENS, slice(2, 4)),
        ):
            part = whole[offset : offset + LENS]
            pixel, by_point, by_lens = project(points, part)
            pixels[:, components] = pixel
            if not derivatives:
                continue
            count = len(points)
            indices = np.broadcast_to(np.arange(offset, offset + LENS), (count, LENS))
            parts.append((components, indices, by_lens))
            by_camera_point = by_point
            if offset:
                by_turn = by_point @ (-cross_matrices(rig_turned) @ left_jacobian(whole[18:21]))
                indices = np.broadcast_to(np.arange(18, 24), (count, 6))
                parts.append((components, indices, np.concatenate([by_turn, by_point], axis=2)))
                by_camera_point = by_point @ rig_turn
            jacobians = np.stack([left_jacobian(pose[:3]) for pose in poses])
            by_rotation = by_camera_point @ (-cross_matrices(turned) @ jacobians[self.pose_of])
            indices = RIG + 6 * self.pose_of[:, None] + np.arange(6)
            parts.append(
                (components, indices, np.concatenate([by_rotation, by_camera_point], axis=2))
            )
            if self.model.shape != 'flat':
                by_corner = by_camera_point @ turns[self.pose_of]
                if self.model.shape == 'free':
                    indices = first + 3 * self.corner_of[:, None] + np.arange(3)
                    parts.append((components, indices, by_corner))
                else:
                    terms = self.give.shape[2]
                    indices = np.broadcast_to(np.arange(first, first + terms), (count, terms))
                    parts.append((components, indices, by_corner @ self.give[self.corner_of]))
        return pixels, parts

    def spread(self, vector: NDArray) -> tuple[float, float]:
        """Robust standard deviation of camera and projector coordinates, pixels."""
        difference = self.modelled(vector)[0] - self.observed
        spent = len(self.active) / max(int(self.known.sum()), 1)
        result = []
        for part in (slice(0, 2), slice(2, 4)):
            known = np.abs(difference[:, part][self.known[:, part]])
            deviation = (
                NORMAL_SPREAD * float(np.median(known)) if len(known) else FIRST_DEVIATIONS[0]
            )
            result.append(max(0.005, deviation / np.sqrt(max(1 - spent, 0.1))))
        return result[0], result[1]


@dataclass(frozen=True, eq=False)
class Adjustment:
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
) -> Adjustment:
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
    Adjustment
    """
    problem = Problem(observations, board, start, model, free, shape)
    vector = np.concatenate([rig_vector(start), poses.ravel(), problem.start_shape])
    if free == 'rig':
        vector[np.setdiff1d(np.arange(RIG), problem.active)] = 0
    estimated = deviations is None
    deviations = deviations or FIRST_DEVIATIONS
    # Weights are standard deviations of camera and projector, found in these rounds; pixels.
    for _ in range(3 if estimated else 1):
        problem.deviations = deviations
        vector = _solve(problem, vector, tolerance)
        if estimated:
            deviations = problem.spread(vector)
    return _estimate(problem, vector, start, poses.shape)


def weighted_jacobian(
    seen: Observation, board: NDArray, estimate: Adjustment, pose: NDArray, model: Model
) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Of one observation's residuals, and the parameters that its columns are of."""
    problem = Problem([seen], board, estimate.rig, model, 'rig', None)
    problem.deviations = estimate.deviations
    vector = np.concatenate([rig_vector(estimate.rig), pose, problem.start_shape])
    return problem.jacobian(vector[problem.active], vector).toarray(), problem.active


def _solve(problem: Problem, vector: NDArray[np.float64], tolerance: float) -> NDArray[np.float64]:
    """All parameters at the least squares."""
    for _ in range(4):
        vector, evaluations = _descend(problem, vector, tolerance)
        if evaluations < 10:
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
    # What the data leave open moves no farther than this makes it.
    factor = cholesky(normal + 1e-10 * np.eye(len(normal)))

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
) -> Adjustment:
    """All that was estimated, of all parameters."""
    first = RIG + 6 * problem.count
    weighted = problem.residuals(vector[problem.active], vector)
    robust = np.minimum(1, np.sqrt(_ROBUST / np.maximum(np.abs(weighted), 1e-12)))
    difference = problem.observed - problem.modelled(vector)[0]
    rows_of_pose = np.broadcast_to(problem.pose_of[:, None], problem.known.shape)[problem.known]
    rows_of_pose = np.concatenate([rows_of_pose, np.full(len(weighted) - len(rows_of_pose), -1)])
    jacobian = problem.jacobian(vector[problem.active], vector).toarray() * robust[:, None]
    return Adjustment(
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


def covariance(estimate: Adjustment) -> NDArray[np.float64]:
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
    seen: Observation, board: NDArray, estimate: Adjustment, pose: NDArray, model: Model
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


def _first_shape(estimate: Adjustment) -> int:
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
