"""Two overlapping clouds to their relative pose, one line a step."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.median import NORMAL_SPREAD
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.survey.patches.patch import Patch
from ftp_dent_ros.survey.registration.alignment import (
    Equations,
    Samples,
    equations,
    moved,
    samples_of,
)
from ftp_dent_ros.survey.registration.coarse_search import candidates, is_right
from ftp_dent_ros.survey.registration.common_errors import in_common
from ftp_dent_ros.survey.registration.information import told_by
from ftp_dent_ros.survey.registration.relative_pose import RelativePose, UnlikePairError

# Share of the second cloud that has to lie on the first, and points; of the few that find the way.
LEAST_OVERLAP, _LEAST_POINTS, _LEAST_FEW = 0.15, 200, 50
# Steps of least squares by few points, and the step that is small enough, metres and radians; the
# last step is by all of them, and comes with what is told.
_STEPS, _COARSE_STEPS, _SHAPE_STEPS, _DONE = 8, 3, 2, 5e-5
# Heights' misfit by what the clouds state, above which they do not show one surface.
_MOST_MISFIT = 25.0
# Share of the points within three standard deviations, that both must have in common.
_LEAST_ALIKE = 0.5
# Standard deviations of a guess within which the truth lies.
_GATE = 5.0
# Of the costs' difference between two places of the paint, beyond which one is the right one.
_CLEARLY = 5.0


def register(
    first: Patch,
    second: Patch,
    guess: Pose,
    doubt: NDArray[np.float64],
    samples: Samples | None = None,
) -> RelativePose:
    """Pose of the second cloud's camera in the first one's frame.

    Parameters
    ----------
    first, second : Patch
    guess : Pose
        Of the second camera in the first one's frame.
    doubt : ndarray, shape (6, 6)
        Covariance of the guess: shift of the second camera along the first one's axes, metres, and
        turn about them, radians.
    samples : Samples, optional
        Of the second patch, if they are known already.

    Raises
    ------
    UnlikePairError
        They do not overlap, or do not lie on each other; the message says in what.
    """
    samples = samples or samples_of(second)
    start = first.frame.inverse() @ guess @ second.frame
    few = samples.few
    centre = _centre(first, few, start)
    spread = _doubt_at(first, guess, doubt, centre)
    prior = np.linalg.inv(spread)
    remark = ''
    is_near = is_right(spread)
    by_shape = start
    if not is_near:
        by_shape = _solved(first, few, start, centre, prior, with_paint=False, steps=_SHAPE_STEPS)
        centre = _centre(first, few, by_shape)
    best, found = by_shape, None
    if first.has_paint and second.has_paint:
        places = [start] if is_near else candidates(first, second, by_shape, centre, spread)
        best, found, remark = _by_paint(
            first, samples, by_shape, centre, prior, places, coarse=not is_near
        )
    else:
        remark = 'without a skin image: laid on each other by their shape alone'
    if found is None:
        found = equations(first, samples, best, centre, with_paint=False)
    _check(found, samples, remark)
    heights = ~found.is_paint
    overlap = heights.sum() / len(samples.heights)
    told = told_by(found, centre, _parallax(first, second, best, centre))
    # What is told is told without the guess.
    best = moved(best, told.step, centre)
    misfit = _misfit(first, few, best)
    pose = first.frame @ best @ second.frame.inverse()
    turn = np.kron(np.eye(2), first.frame.rotation.as_matrix())
    return RelativePose(
        pose,
        first.frame.apply(centre),
        turn @ told.information @ turn.T,
        told.count,
        overlap,
        misfit,
        remark,
        turn @ in_common(centre, best),
    )


def _by_paint(first, samples, by_shape, centre, prior, places, coarse):
    """The pose at which the paints lie on each other, unless there is none, or more than one."""
    few = samples.few
    tried: list[tuple[float, Pose, Equations]] = []
    loose = prior * 1e-3
    for pose in places:
        if coarse:
            pose = _solved(first, few, pose, centre, loose, coarse=True, steps=_COARSE_STEPS)
        pose = _solved(first, few, pose, centre, loose)
        off = _off(pose, by_shape, centre)
        if off @ prior @ off > _GATE**2 + 6:
            continue
        found = equations(first, samples, pose, centre)
        paint = found.is_paint
        if paint.sum() < _LEAST_POINTS:
            continue
        tried.append((_alike(found), pose, found))
    if not tried:
        return by_shape, None, 'its paint is found nowhere on the other: by their shape alone'
    tried.sort(key=lambda each: -each[0])
    chosen = tried[0]
    for other in tried[1:]:
        if np.linalg.norm(_off(other[1], chosen[1], centre)[:3]) < 1e-3:
            continue
        if _difference(first, samples, chosen[1], other[1], centre) < _CLEARLY:
            return by_shape, None, 'its marks fit in more places than one: by their shape alone'
    return chosen[1], chosen[2], ''


def _solved(
    first: Patch,
    samples: Samples,
    pose: Pose,
    centre: NDArray[np.float64],
    prior: NDArray[np.float64],
    with_paint: bool = True,
    coarse: bool = False,
    steps: int = _STEPS,
) -> Pose:
    """Pose of least squares, held by the guess where the patches do not tell."""
    guess = pose
    for _ in range(steps):
        found = equations(first, samples, pose, centre, with_paint, coarse)
        if (~found.is_paint).sum() < _LEAST_FEW:
            raise UnlikePairError('they do not overlap')
        both = (found.own + found.other) / 2
        normal = both.T @ (both * found.weight[:, None]) + prior
        gradient = found.score.sum(axis=0) + prior @ _off(pose, guess, centre)
        step = -np.linalg.solve(normal, gradient)
        pose = moved(pose, step, centre)
        if np.abs(step[:3]).max() < _DONE and np.abs(step[3:]).max() < _DONE:
            break
    return pose


def _centre(first: Patch, samples: Samples, pose: Pose) -> NDArray[np.float64]:
    place = pose.apply(samples.heights)
    met = np.isfinite(first.looked_up(first.surface, place)[:, 0])
    if met.sum() < max(_LEAST_FEW, LEAST_OVERLAP * len(place)):
        raise UnlikePairError('they do not overlap')
    return place[met].mean(axis=0)


def _doubt_at(first, guess, doubt, centre):
    """Covariance of a guess, as of the shift of the centre and the turn, first patch's axes."""
    arm = first.frame.apply(centre) - guess.translation
    carried = np.eye(6)
    carried[:3, 3:] = [[0, arm[2], -arm[1]], [-arm[2], 0, arm[0]], [arm[1], -arm[0], 0]]
    turn = np.kron(np.eye(2), first.frame.rotation.as_matrix())
    return turn.T @ carried @ doubt @ carried.T @ turn


def _parallax(
    first: Patch, second: Patch, pose: Pose, centre: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Difference of the directions from which the centre is seen, shape (2,), patch's axes."""
    cameras = first.frame.inverse(), pose @ second.frame.inverse()
    views = [camera.translation - centre for camera in cameras]
    return views[1][:2] / views[1][2] - views[0][:2] / views[0][2]


def _off(pose: Pose, other: Pose, centre: NDArray[np.float64]) -> NDArray[np.float64]:
    """Shift of the centre, and turn, from another pose to a pose."""
    move = pose @ other.inverse()
    return np.concatenate([move.apply(centre) - centre, move.rotation.as_rotvec()])


def _alike(found: Equations) -> float:
    """Correlation of the slopes of the paints."""
    paint = found.is_paint
    own, other = found.own[paint, :2], found.other[paint, :2]
    return float((own * other).sum() / np.sqrt((own**2).sum() * (other**2).sum()))


def _difference(first, samples, pose, other, centre) -> float:
    """How much better the paint fits at one pose than at another, in standard deviations."""
    costs = []
    for each in (pose, other):
        place = each.apply(samples.paint)
        here = first.looked_up(first.paint, place)
        met = here[:, 3] > 0.99
        costs.append(np.where(met, np.abs(here[:, 0] - samples.paint_values[:, 0]), np.nan))
    gain = costs[1] - costs[0]
    gain = gain[np.isfinite(gain)]
    if not len(gain):
        return 0.0
    return float(gain.sum() / np.sqrt(np.square(gain).sum()))


def _check(found: Equations, samples: Samples, remark: str) -> None:
    heights = ~found.is_paint
    if heights.sum() < max(_LEAST_POINTS, LEAST_OVERLAP * len(samples.heights)):
        raise UnlikePairError('they do not overlap')
    if found.spread[0] > _MOST_MISFIT:
        raise UnlikePairError(
            f'their heights differ {found.spread[0]:.0f} times as much as they state'
        )
    if np.mean(np.abs(found.residual[heights]) < 3) < _LEAST_ALIKE:
        raise UnlikePairError('most of their heights differ')


def _misfit(first: Patch, samples: Samples, pose: Pose) -> float:
    place = pose.apply(samples.heights)
    here = first.looked_up(first.surface, place)
    off = place[:, 2] - here[:, 0]
    off = off[np.isfinite(off)]
    return float(NORMAL_SPREAD * np.median(np.abs(off)))
