"""Two overlapping clouds to their relative pose, one line a step."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.pose import Pose
from ftp_dent_ros.rigid import about, moved
from ftp_dent_ros.robust import deviation
from ftp_dent_ros.survey.alignment import PairEquations, Samples, equations, samples_of
from ftp_dent_ros.survey.information import (
    RelativePose,
    UnlikePairError,
    in_common,
    slid_information,
    told_by,
)
from ftp_dent_ros.survey.patch import SkinPatch
from ftp_dent_ros.survey.places import Guess, Place, candidates, is_right, not_worse, slid

# Share of the second cloud that has to lie on the first, and points; of the few that find the way.
LEAST_OVERLAP, _LEAST_POINTS, _LEAST_FEW = 0.15, 200, 50
# Steps of least squares by few points, and the step that is small enough, metres and radians; the
# last step is by all of them, and comes with what is told.
_STEPS, _SHAPE_STEPS, _DONE = 8, 2, 5e-5
# Standard deviations of a guess within which the truth lies.
_GATE = 5.0
_NO_PAINT = 'without a skin image: laid on each other by their shape alone'
_NOWHERE = 'its paint is found nowhere on the other: by their shape alone'
_AMBIGUOUS = 'its marks fit in more places than one: by their shape alone'


def register(
    first: SkinPatch,
    second: SkinPatch,
    guess: Pose,
    doubt: NDArray[np.float64],
    samples: Samples | None = None,
    known: NDArray[np.float64] | None = None,
) -> RelativePose:
    """Pose of the second cloud's camera in the first one's frame.

    Parameters
    ----------
    first, second : SkinPatch
    guess : Pose
        Of the second camera in the first one's frame.
    doubt : ndarray, shape (6, 6)
        Covariance of the guess: shift of the second camera along the first one's axes, metres, and
        turn about them, radians.
    samples : Samples, optional
        Of the second patch, if they are known already.
    known : ndarray, shape (6, 6), optional
        What is doubted as well as it is known by others, which may be wrong: where the paint tells
        no place within it, it is looked for within `doubt`.

    Raises
    ------
    UnlikePairError
        They do not overlap, or do not lie on each other; the message says in what.
    """
    samples = samples or samples_of(second)
    few = samples.few
    start = first.frame.inverse() @ guess @ second.frame
    centre = _centre(first, few, start)
    for each in (doubt,) if known is None else (known, doubt):
        near = Guess(start, centre, _doubt_at(first, guess, each, centre))
        best, near, found, remark = _placed(first, second, samples, near)
        if found is not None or remark == _NO_PAINT:
            break
    centre = near.centre
    if found is None:
        found = equations(first, samples, best, centre, with_paint=False)
    _check(found, samples, remark)
    heights = ~found.is_paint
    overlap = heights.sum() / len(samples.heights)
    told = told_by(found, centre, _parallax(first, second, best, centre))
    # What is told is told without the guess.
    best = moved(best, told.step, centre)
    information = told.information
    if remark:

        def laid(pose: Pose, held: NDArray[np.float64]) -> Pose:
            return _laid(first, few, pose, centre, held)

        information = slid_information(told, best, centre, near.doubt, laid)
    misfit = _misfit(first, few, best)
    pose = first.frame @ best @ second.frame.inverse()
    turn = np.kron(np.eye(2), first.frame.rotation.as_matrix())
    return RelativePose(
        pose,
        first.frame.apply(centre),
        turn @ information @ turn.T,
        told.count,
        overlap,
        misfit,
        remark,
        turn @ in_common(centre, best),
    )


def _placed(
    first: SkinPatch, second: SkinPatch, samples: Samples, near: Guess
) -> tuple[Pose, Guess, PairEquations | None, str]:
    """The pose by paint with its equations; or by shape alone, and why."""
    by_shape, places = near.pose, None
    if not is_right(near.doubt):
        prior = np.linalg.inv(near.doubt)
        by_shape = _laid(first, samples.few, near.pose, near.centre, prior)
        near = replace(near, centre=_centre(first, samples.few, by_shape))
    if not (first.has_paint and second.has_paint):
        return by_shape, near, None, _NO_PAINT
    if not is_right(near.doubt):
        places = candidates(first, second, by_shape, near.centre, near.doubt)
    pose, remark = _by_paint(first, samples, places, near)
    if pose is not None:
        found = equations(first, samples, pose, near.centre)
        if found.is_paint.sum() >= _LEAST_POINTS and near.away(pose)[1] <= _GATE**2:
            return pose, near, found, ''
    return by_shape, near, None, remark


def _by_paint(
    first: SkinPatch, samples: Samples, places: list[Pose] | None, near: Guess
) -> tuple[Pose | None, str]:
    """The pose at which the paints lie on each other, unless there is none, or more than one."""
    few, pose = samples.few, near.pose
    loose = 1e-3 * np.linalg.inv(near.doubt).astype(float)
    if places is not None:
        # Places that are alike at first sight: more cannot all be judged.
        if len(places) > 32:
            return None, _AMBIGUOUS
        # How high and how tilted they lie is the shape's to tell: a curved skin turns what slides
        # on it by far more than a guess is unsure of at its own place.
        # By how much a place may move along the skin as patches are laid on each other there: the
        # cells that it was found by, metres.
        held = np.diag([1 / 0.003**2] * 2 + [0.0] * 3 + [loose[5, 5]])
        slidden = [slid(first, few, each, near.centre, held) for each in places]
        rough = (Place.at(first, few, each, near, rough=True) for each in slidden)
        left = not_worse(rough, len(places))
        judged = (_judged(first, samples, each, near, held) for each in left)
        # As many that are as good as the best one are enough to give up.
        left = not_worse(judged, 2)
        if len(left) != 1:
            return None, _AMBIGUOUS if left else _NOWHERE
        pose = left[0].pose
    return _solved(first, few, pose, near.centre, loose), _NOWHERE


def _judged(
    first: SkinPatch, samples: Samples, place: Place, near: Guess, held: NDArray[np.float64]
) -> Place:
    """A place with the patches laid on each other there, by all samples."""
    try:
        pose = _solved(first, samples.few, place.pose, near.centre, held)
    except UnlikePairError:
        # Where they do not overlap, the guess alone tells how likely they lie.
        return replace(place, misfits=())
    return Place.at(first, samples, pose, near)


def _solved(
    first: SkinPatch,
    samples: Samples,
    pose: Pose,
    centre: NDArray[np.float64],
    prior: NDArray[np.float64],
    with_paint: bool = True,
    steps: int = _STEPS,
) -> Pose:
    """Pose of least squares, held by the guess where the patches do not tell."""
    off = np.zeros(6)
    for _ in range(steps):
        found = equations(first, samples, pose, centre, with_paint)
        if (~found.is_paint).sum() < _LEAST_FEW:
            raise UnlikePairError('they do not overlap')
        both = (found.own + found.other) / 2
        normal = both.T @ (both * found.weight[:, None]) + prior
        gradient = found.score.sum(axis=0) + prior @ off
        step = -np.linalg.solve(normal, gradient)
        pose, off = moved(pose, step, centre), off + step
        if np.abs(step[:3]).max() < _DONE and np.abs(step[3:]).max() < _DONE:
            break
    return pose


def _laid(first, few, pose, centre, prior):
    """Pose by the shape alone."""
    return _solved(first, few, pose, centre, prior, with_paint=False, steps=_SHAPE_STEPS)


def _centre(first: SkinPatch, samples: Samples, pose: Pose) -> NDArray[np.float64]:
    place = pose.apply(samples.heights)
    met = np.isfinite(first.looked_up(first.surface, place)[:, 0])
    if met.sum() < max(_LEAST_FEW, LEAST_OVERLAP * len(place)):
        raise UnlikePairError('they do not overlap')
    return place[met].mean(axis=0)


def _doubt_at(first, guess, doubt, centre):
    """Covariance of a guess, as of the shift of the centre and the turn, first patch's axes."""
    arm = first.frame.apply(centre) - guess.translation
    carried = np.eye(6)
    carried[:3] = about(arm)
    turn = np.kron(np.eye(2), first.frame.rotation.as_matrix())
    return turn.T @ carried @ doubt @ carried.T @ turn


def _parallax(
    first: SkinPatch, second: SkinPatch, pose: Pose, centre: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Difference of the directions from which the centre is seen, shape (2,), patch's axes."""
    cameras = first.frame.inverse(), pose @ second.frame.inverse()
    views = [camera.translation - centre for camera in cameras]
    return views[1][:2] / views[1][2] - views[0][:2] / views[0][2]


def _check(found: PairEquations, samples: Samples, remark: str) -> None:
    heights = ~found.is_paint
    if heights.sum() < max(_LEAST_POINTS, LEAST_OVERLAP * len(samples.heights)):
        raise UnlikePairError('they do not overlap')
    # Heights' misfit by what the clouds state, above which they do not show one surface.
    if found.spread[0] > 25.0:
        raise UnlikePairError(
            f'their heights differ {found.spread[0]:.0f} times as much as they state'
        )
    # Share of the points within three standard deviations, that both must have in common.
    if np.mean(np.abs(found.residual[heights]) < 3) < 0.5:
        raise UnlikePairError('most of their heights differ')


def _misfit(first: SkinPatch, samples: Samples, pose: Pose) -> float:
    place = pose.apply(samples.heights)
    here = first.looked_up(first.surface, place)
    off = place[:, 2] - here[:, 0]
    off = off[np.isfinite(off)]
    return deviation(off)
