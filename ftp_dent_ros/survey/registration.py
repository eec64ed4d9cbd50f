"""Two overlapping clouds to their relative pose, one line a step.

Skins repeat themselves: a row of rivets lies on itself again a pitch farther. The paint of one
patch is looked for on the other's over all shifts at once; what decides between two places is
what does not repeat itself, and how far the guess lies from either. Source of the correlation of
partly known images: D. Padfield, IEEE Transactions on Image Processing 21, 2706 (2012).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ftp_dent_ros.pose import Pose
from ftp_dent_ros.rigid import Array, moved, moved_along, seen_along, twist_between
from ftp_dent_ros.survey.alignment import (
    APART,
    PairEquations,
    UnlikePairError,
    equations,
    of_heights,
    painted,
)
from ftp_dent_ros.survey.information import RelativePose, in_common, pair_information
from ftp_dent_ros.survey.patch import Samples, SkinPatch
from ftp_dent_ros.survey.raster import remap

# Share of the second cloud that has to lie on the first, and points of its paint.
_LEAST_OVERLAP, _LEAST_PAINT = 0.15, 200
_NOWHERE = 'its paint is found nowhere on the other: by their shape alone'

# Standard deviations of the evidence against a place beyond which it is not the right one.
_CLEARLY = 4.5


# Of the cells that are correlated, metres: marks are a few millimetres wide.
_CELL = 0.003
# Standard deviations of the guess within which the truth lies: all but 3e-4, along the skin.
_WITHIN = 4.0
# About the normal: what moves no mark farther than it is wide, radians.
_TURN = 0.008
# A peak's correlation, and that by the highest one's, from which on it may be the place.
_RIVAL = 0.6


def register(
    first: SkinPatch,
    second: SkinPatch,
    guess: Pose,
    doubt: NDArray[np.float64],
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

    Raises
    ------
    UnlikePairError
        They do not overlap, or do not lie on each other; the message says in what.
    """
    samples, few = second.samples, second.samples.few
    start = first.frame.inverse() @ guess @ second.frame
    centre = _centre(first, few, start)
    arm, axes = first.frame.apply(centre) - guess.translation, first.frame.rotation.as_matrix()
    near = Guess(start, centre, seen_along(doubt, axes, arm))
    best = _laid(first, few, start, centre, np.linalg.inv(near.doubt))
    found, remark = None, 'without a skin image: laid on each other by their shape alone'
    if first.light is not None and second.light is not None:
        best, found, remark = _by_paint(first, second, best, near)
    found = found or of_heights(first, samples, best, centre)
    # Heights' misfit by what the clouds state, above which they do not show one surface.
    if found.spread > 25.0:
        raise UnlikePairError(
            f'their heights differ {found.spread:.0f} times as much as they state'
        )
    # Difference of the directions from which the centre is seen, along the patch's axes.
    cameras = first.frame.inverse(), best @ second.frame.inverse()
    here, there = (camera.translation - centre for camera in cameras)
    parallax = there[:2] / there[2] - here[:2] / here[2]
    step, information, rank = pair_information(found, centre, parallax)
    # The result is that of the patches, without the guess.
    best = moved(best, step, centre)
    if remark and rank not in (0, 6):
        information = _slid_information(first, few, best, near, information, rank)
    pose = first.frame @ best @ second.frame.inverse()
    turn = np.kron(np.eye(2), first.frame.rotation.as_matrix())
    return RelativePose(
        pose,
        first.frame.apply(centre),
        turn @ information @ turn.T,
        rank,
        remark,
        turn @ in_common(centre, best),
    )


def laid_over(first: SkinPatch, second: SkinPatch, guess: Pose) -> Pose:
    """A guess of the second camera in the first one's frame, with their patches laid over another.

    Of the guess the turn about the skin's normal is left.
    """
    turn = (first.frame.inverse() @ guess @ second.frame).rotation.as_matrix()
    about_normal = Rotation.from_euler('z', np.arctan2(turn[1, 0], turn[0, 0]))
    return first.frame @ Pose(about_normal, np.zeros(3)) @ second.frame.inverse()


def _slid_information(
    first: SkinPatch,
    samples: Samples,
    pose: Pose,
    near: Guess,
    information: Array,
    rank: int,
) -> Array:
    """Information on a pose by shape, wherever within its doubt the patches lie, (6, 6)."""
    # Turns as shifts: of a radian so many metres, half of a patch.
    scale = np.array([1, 1, 1, 1 / 0.15, 1 / 0.15, 1 / 0.15])
    both, centre = np.outer(scale, scale), near.centre
    values, directions = np.linalg.eigh(information * both)
    free, sure = directions[:, : 6 - rank], directions[:, 6 - rank :]
    spread = np.linalg.inv((np.linalg.inv(near.doubt) + information) * both)
    variances, ways = np.linalg.eigh(free.T @ spread @ free)
    # By how much a patch that is slid may slide on while it is laid on the other, metres.
    held = free @ free.T / both / 1e-5**2
    covariance = np.diag(1 / values[6 - rank :])
    for step in (free @ ways * np.sqrt(variances)).T:
        try:
            other = _laid(first, samples, moved_along(pose, step * scale, centre), centre, held)
        except UnlikePairError:
            continue
        change = sure.T @ (twist_between(pose, other, centre) / scale)
        covariance += np.outer(change, change)
    return sure @ np.linalg.inv(covariance) @ sure.T / both


def _by_paint(
    first: SkinPatch, second: SkinPatch, by_shape: Pose, near: Guess
) -> tuple[Pose, PairEquations | None, str]:
    """The one pose at which the paints lie on each other, and its equations.

    Where there is none, or more than one: the pose by the shape, and why.
    """
    samples, few = second.samples, second.samples.few
    places = candidates(first, second, by_shape, near)
    # How high and how tilted they lie is the shape's to tell: a curved skin turns what slides
    # on it by far more than a guess is unsure of at its own place.
    # By how much a place may move along the skin as patches are laid on each other there: the
    # cells that it was found by, metres.
    held = np.diag([1 / _CELL**2] * 2 + [0.0] * 3 + [1 / near.doubt[5, 5]])
    by_few = partial(equations, first, few, centre=near.centre)
    nearly = (_solved(by_few, each, near.centre, held, steps=4) for each in places)
    left = _best_of(Place.at(first, samples, each, near) for each in nearly)
    if len(left) != 1:
        several = 'its marks fit in more places than one: by their shape alone'
        return by_shape, None, several if left else _NOWHERE
    pose = _solved(by_few, left[0].pose, near.centre, held)
    found = equations(first, samples, pose, near.centre)
    few_painted = np.count_nonzero(painted(first, samples, pose)[1]) < _LEAST_PAINT
    if few_painted or near.away(pose)[1] > _WITHIN**2:
        return by_shape, None, _NOWHERE
    return pose, found, ''


def _laid(first: SkinPatch, few: Samples, pose: Pose, centre: Array, prior: NDArray) -> Pose:
    """Pose by the shape alone: nearly, as it slides."""
    return _solved(partial(of_heights, first, few, centre=centre), pose, centre, prior, steps=2)


def _solved(
    linearised: Callable[..., PairEquations],
    pose: Pose,
    centre: Array,
    prior: NDArray,
    steps: int = 12,
) -> Pose:
    """Pose of least squares, held by the guess where the patches do not tell."""
    off = np.zeros(6)
    for _ in range(steps):
        found = linearised(pose=pose)
        weighted = found.both.T * found.weight
        gradient = weighted @ found.residual + prior @ off
        step = -np.linalg.solve(weighted @ found.both + prior, gradient)
        pose, off = moved(pose, step, centre), off + step
        # Metres and radians; the last step is by all points, and comes with its information.
        if np.abs(step).max() < 2e-5:
            break
    return pose


def _centre(first: SkinPatch, samples: Samples, pose: Pose) -> NDArray[np.float64]:
    place = pose.apply(samples.heights)
    met = np.isfinite(first.below(place)[:, 0])
    if met.sum() <= _LEAST_OVERLAP * len(place):
        raise UnlikePairError(APART)
    return place[met].mean(axis=0)


@dataclass(frozen=True, eq=False)
class Guess:
    """Where the second patch is thought to lie on the first one.

    Attributes
    ----------
    pose : Pose
    centre : ndarray, shape (3,)
        Of what both see, metres.
    doubt : ndarray, shape (6, 6)
        Covariance of the shift of the centre, and of the turn about it.
    """

    pose: Pose
    centre: Array
    doubt: Array

    def away(self, pose: Pose) -> tuple[Array, float]:
        """How far along the skin a pose shifts the centre, and its square in sigmas."""
        shift = ((pose @ self.pose.inverse()).apply(self.centre) - self.centre)[:2]
        return shift, float(shift @ np.linalg.solve(self.doubt[:2, :2], shift))


@dataclass(frozen=True, eq=False)
class Place:
    """A place of the second patch on the first.

    Attributes
    ----------
    pose : Pose
        Of the second patch in the first.
    shift : ndarray, shape (2,)
        Of the middle of what both see, along the skin, from the guess, metres.
    unlikely : float
        As of `Guess.away`.
    misfits : (ndarray, ndarray), each of shape (n,)
        How far the samples' paints, and their heights, differ from what is below them; NaN where
        nothing is.
    """

    pose: Pose
    shift: Array
    unlikely: float
    misfits: tuple[Array, ...]

    @classmethod
    def at(cls, first: SkinPatch, samples: Samples, pose: Pose, near: Guess) -> Place:
        """Look up what lies below the samples."""
        below, met = painted(first, samples, pose)
        paint = np.where(met, np.abs(below[:, 0] - samples.paint_values[:, 0]), np.nan)
        place = pose.apply(samples.heights)
        below = first.below(place)
        sigma = np.hypot(below[:, 3], samples.height_values[:, 3])
        height = np.abs(place[:, 2] - below[:, 0]) / sigma
        return cls(pose, *near.away(pose), (paint, height))

    def is_rival_of(self, best: Place) -> bool:
        """Whether it is not clearly worse than the best place, nor that place found twice."""
        is_same = np.hypot(*(self.shift - best.shift)) < _CELL
        return not is_same and self.evidence_against(best) < _CLEARLY**2

    def evidence_against(self, other: Place) -> float:
        """Twice the logarithm of the odds of another place against this one.

        Only what is seen at both is compared. Misfits have long tails, so that their differences
        are counted by their own size: as a sum of so many standard deviations.
        """
        evidence = self.unlikely - other.unlikely
        for mine, others in zip(self.misfits, other.misfits, strict=True):
            gain = mine - others
            gain = gain[np.isfinite(gain)]
            square = np.square(gain).sum()
            # Points near each other err alike, and count as so many fewer: rendered rivets of four
            # pitches, and nothing else, tell their pitches apart by 1.8 standard deviations too
            # often. Of no points there is no evidence.
            evidence += gain.sum() * abs(gain.sum()) / max(square * 3.3, 1e-12)
        return float(evidence)


def _best_of(places: Iterable[Place]) -> list[Place]:
    """The best place, and another one if it is not clearly worse, which is enough to give up."""
    left: list[Place] = []
    for place in places:
        both = [*left, place]
        best = min(both, key=lambda each: max(each.evidence_against(other) for other in both))
        left = [best, *(each for each in both if each is not best and each.is_rival_of(best))]
        if len(left) > 1:
            break
    return left


def candidates(
    first: SkinPatch,
    second: SkinPatch,
    guess: Pose,
    near: Guess,
) -> Iterator[Pose]:
    """Poses of the second patch in the first at which their paints look alike, the best first.

    Parameters
    ----------
    guess : Pose
        Of the second patch in the first, right along the normal and in tilt.
    near : Guess
        About whose centre it may be off, and by how much.
    """
    across, centre = np.sqrt(np.diag(near.doubt)), near.centre
    # As far as is looked for at most, metres: most of what a cloud sees.
    reach = np.clip(_WITHIN * across[:2], 2 * _CELL, 0.2)
    found: list[tuple[float, NDArray[np.float64]]] = []
    for turn in _turns(first, second.samples.few, guess, near):
        # That leaves no doubt that the turn is nearly right.
        if found and found[0][0] > _RIVAL:
            break
        pose = moved(guess, np.array([0, 0, 0, 0, 0, turn]), centre)
        for height, shift in _peaks(first, second, pose, reach):
            found.append((height, np.array([*shift, 0, 0, 0, turn])))
        found.sort(key=lambda each: -each[0])
    for height, step in found:
        if height >= _RIVAL * found[0][0]:
            yield moved(guess, step, centre)


def _turns(first: SkinPatch, few: Samples, guess: Pose, near: Guess) -> Iterator[float]:
    """Turns about the normal to look at, ever larger ones: as far as doubt and shape allow."""
    yield 0.0
    shape = of_heights(first, few, guess, near.centre)
    _, information, _ = pair_information(shape, near.centre, np.zeros(2))
    doubt = np.sqrt(np.linalg.inv(np.linalg.inv(near.doubt) + information)[5, 5])
    for step in range(1, int(_WITHIN * doubt / _TURN) + 1):
        yield from (step * _TURN, -step * _TURN)


def _peaks(
    first: SkinPatch, second: SkinPatch, pose: Pose, reach: NDArray
) -> list[tuple[float, NDArray]]:
    """Correlations and shifts of the maxima within reach that rival the highest one."""
    every = max(1, round(_CELL / first.pitch))
    size = every * first.pitch
    steps = np.ceil(reach / size).astype(int)
    still, still_known = np.moveaxis(first.paints[1][::every, ::every], -1, 0)
    shape = np.array(still.shape) + 2 * steps[::-1]
    # On the first one's grid, that begins so many steps before it. Both are taken for flat: what
    # their heights shift by their difference in tilt is less than a cell.
    grid = first.corner + size * (np.moveaxis(np.indices(shape)[::-1], 0, -1) - steps)
    back = np.linalg.inv(pose.rotation.as_matrix()[:2, :2])
    at = ((grid - pose.translation[:2]) @ back.T - second.corner) / second.pitch
    u, v = np.moveaxis(at.astype(np.float32), -1, 0)
    # What lies beyond is not known; a cell beside it is not, either.
    paint = second.paints[1]
    known = remap(paint[..., 1], u, v) > 0.99
    seen = np.where(known, remap(paint[..., 0], u, v), np.float32(0))
    # The second image begins so many steps earlier. Of two places that are as alike, the one with
    # more of the first's paint in common.
    alike = cv2.matchTemplate(seen, still, cv2.TM_CCORR_NORMED, mask=still_known)[::-1, ::-1]
    value = np.where(np.abs(alike) <= 1, alike, 0)
    highest = cv2.dilate(value, np.ones((5, 5), np.uint8))
    return [
        (float(value[row, column]), (np.array([column, row]) - steps) * size)
        for row, column in np.argwhere((value >= highest) & (value > _RIVAL * value.max()))
    ]
