"""Places of one patch on another between which has to be decided: by paint, shape and the guess.

Skins repeat themselves: a row of rivets lies on itself again a pitch farther. What decides
between two places is what does not repeat itself, and how far the guess lies from either.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import fft

from ftp_dent_ros.pose import Pose
from ftp_dent_ros.rigid import moved
from ftp_dent_ros.survey.alignment import Samples, of_paint
from ftp_dent_ros.survey.patch import SkinPatch
from ftp_dent_ros.survey.resampling import Grid

# Standard deviations of the evidence against a place beyond which it is not the right one.
_CLEARLY = 4.5
# Directions in which a patch slides on another, and steps until it lies there.
_SLIDING, _STEPS = [0, 1, 5], 2

Array = NDArray[np.float64]

# Of the cells that are correlated, metres: marks are a few millimetres wide.
_CELL = 0.003
# Standard deviations of the guess within which is looked for, and the least and most, metres.
_WITHIN, _LEAST_REACH, _MOST_REACH = 4.0, 0.006, 0.2
# About the normal: what moves no mark farther than it is wide, radians.
_TURN = 0.008
# A peak's correlation by the highest one's from which on both are looked at.
_RIVAL = 0.6


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
        """How far along the skin a pose shifts the centre, and the square of it in sigmas."""
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
        Square of that, in standard deviations.
    misfits : tuple of ndarrays, shape (n,)
        How far the samples' paints, and their heights, differ from what is below them; NaN where
        nothing is. Empty where the patches do not overlap: then the guess alone decides.
    """

    pose: Pose
    shift: Array
    unlikely: float
    misfits: tuple[Array, ...]

    @classmethod
    def at(
        cls, first: SkinPatch, samples: Samples, pose: Pose, near: Guess, rough: bool = False
    ) -> Place:
        """Look up what lies below the samples; roughly: by the coarse paint alone."""
        layer, values = (
            (first.coarse, samples.coarse_values) if rough else (first.paint, samples.paint_values)
        )
        below = first.looked_up(layer, pose.apply(samples.paint))
        met = (below[:, 3] > 0.99) & (values[:, 3] > 0)
        misfits = [np.where(met, np.abs(below[:, 0] - values[:, 0]), np.nan)]
        if not rough:
            place = pose.apply(samples.heights)
            below = first.looked_up(first.surface, place)
            sigma = np.hypot(below[:, 3], samples.height_values[:, 3])
            misfits.append(np.abs(place[:, 2] - below[:, 0]) / sigma)
        shift, unlikely = near.away(pose)
        return cls(pose, shift, unlikely, tuple(misfits))

    def is_same(self, other: Place) -> bool:
        """Whether both are one place, found twice."""
        # Nearer than this they are one, metres: the cells in which places are looked for.
        return bool(np.hypot(*(self.shift - other.shift)) < 0.003)

    def evidence_against(self, other: Place) -> float:
        """Twice the logarithm of the odds of another place against this one.

        Only what is seen at both is compared. Misfits have long tails, so that their differences
        are counted by their own size: as a sum of so many standard deviations.
        """
        evidence = self.unlikely - other.unlikely
        for mine, others in zip(self.misfits, other.misfits, strict=False):
            gain = mine - others
            gain = gain[np.isfinite(gain)]
            square = np.square(gain).sum()
            if square > 0:
                # Points near each other err alike, and count as so many fewer: rendered rivets of
                # four pitches, and nothing else, tell their pitches apart by 1.8 standard
                # deviations too often.
                evidence += gain.sum() * abs(gain.sum()) / (square * 3.3)
        return float(evidence)


def slid(first: SkinPatch, samples: Samples, pose: Pose, centre: Array, held: Array) -> Pose:
    """Where the coarse paints lie on each other near a pose, as it slides and turns on the skin.

    Parameters
    ----------
    held : ndarray, shape (6, 6)
        Inverse covariance of how far that may be.
    """
    free = np.ix_(_SLIDING, _SLIDING)
    for _ in range(_STEPS):
        (residual, own, other, weight, _), _ = of_paint(first, samples, pose, centre, coarse=True)
        both = (own + other)[:, _SLIDING] / 2
        normal = both.T @ (both * weight[:, None]) + held[free]
        step = np.zeros(6)
        step[_SLIDING] = -np.linalg.solve(normal, both.T @ (weight * residual))
        pose = moved(pose, step, centre)
    return pose


def not_worse(places: Iterable[Place], most: int) -> list[Place]:
    """Of some places the best, and those that are not clearly worse, in order of evidence."""
    others = iter(places)
    best = next(others, None)
    left: list[Place] = []
    if best is None:
        return left
    for place in others:
        if place.is_same(best):
            continue
        evidence = place.evidence_against(best)
        if evidence < 0:
            best, place, evidence = place, best, -evidence
        if evidence < _CLEARLY**2:
            left.append(place)
        if len(left) > most:
            break
    left = [each for each in left if not each.is_same(best)]
    against = [(each.evidence_against(best), each) for each in left]
    against = sorted((each for each in against if each[0] < _CLEARLY**2), key=lambda each: each[0])
    return [best, *(place for _, place in against)]


def is_right(doubt: NDArray[np.float64]) -> bool:
    """Whether a guess with a covariance of the shift and the turn needs no search."""
    # Of a guess that is right to less than this, metres, nothing is looked for: half of what the
    # coarse paint is smoothed by.
    return bool(_WITHIN * np.sqrt(np.diag(doubt)[:2].max()) < 0.001)


def candidates(
    first: SkinPatch,
    second: SkinPatch,
    guess: Pose,
    centre: NDArray[np.float64],
    doubt: NDArray[np.float64],
) -> list[Pose]:
    """Poses of the second patch in the first at which their paints look alike, the best first.

    Parameters
    ----------
    guess : Pose
        Of the second patch in the first, right along the normal and in tilt.
    centre : ndarray, shape (3,)
        About which `doubt` turns, in the first patch's frame, metres.
    doubt : ndarray, shape (6, 6)
        Covariance of the guess: shift of the centre, and turn.
    """
    across = np.sqrt(np.diag(doubt))
    reach = np.clip(_WITHIN * across[:2], _LEAST_REACH, _MOST_REACH)
    turns = np.arange(-3, 4) * _TURN
    turns = turns[np.abs(turns) <= max(_WITHIN * across[5], _TURN / 2)]
    turns = turns[np.argsort(np.abs(turns), kind='stable')]
    found: list[tuple[float, NDArray[np.float64]]] = []
    for turn in turns:
        # Correlation that leaves no doubt that the turn is nearly right.
        if found and found[0][0] > 0.6:
            break
        pose = moved(guess, np.array([0, 0, 0, 0, 0, turn]), centre)
        for height, shift in _peaks(first, second, pose, reach):
            found.append((height, np.array([*shift, 0, 0, 0, turn])))
        found.sort(key=lambda each: -each[0])
    kept: list[NDArray[np.float64]] = []
    for height, step in found:
        if height < _RIVAL * found[0][0]:
            break
        if all(np.hypot(*(other - step)[:2]) > 2 * _CELL for other in kept):
            kept.append(step)
    return [moved(guess, step, centre) for step in kept]


def _peaks(
    first: SkinPatch, second: SkinPatch, pose: Pose, reach: NDArray
) -> list[tuple[float, NDArray]]:
    """Correlations and shifts of the maxima within reach that rival the highest one."""
    size = max(1, round(_CELL / first.pitch)) * first.pitch
    steps = np.ceil(reach / size).astype(int)
    cells = [-(-n // round(size / first.pitch)) for n in first.height.shape]
    # As far beyond the first patch as the second may lie off: nothing comes round the other side.
    rows, columns = (
        fft.next_fast_len(int(n + 2 * s), real=True)
        for n, s in zip(cells, steps[::-1], strict=True)
    )
    still = _spectra_of_first(first, size, (rows, columns))
    image = _seen_by_first(first, second, pose, size, steps, (rows, columns))
    others = _spectra(image[..., 0], image[..., 1])

    def correlated(a: int, b: int) -> NDArray[np.float32]:
        whole = np.asarray(fft.irfft2(still[a] * np.conj(others[b]), (rows, columns)))
        # The second image begins so many steps earlier.
        down, across = (np.arange(-2 * s, 1) for s in steps[::-1])
        return whole[np.ix_(down % rows, across % columns)]

    count = correlated(2, 2)
    # Of the smaller image, that has to overlap.
    least = 0.1 * min(float(still[2][0, 0].real), float(others[2][0, 0].real))
    power = np.sqrt(np.maximum(correlated(1, 2) * correlated(2, 1), 1e-12))
    # Of two that are as alike, the one with more in common.
    value = np.where(count > max(least, 1), correlated(0, 0) / power, 0) * np.sqrt(
        np.clip(count / max(float(count.max()), 1.0), 0, 1)
    )
    value = value.astype(np.float32)
    highest = cv2.dilate(value, np.ones((5, 5), np.uint8))
    return [
        (float(value[row, column]), (np.array([column, row]) - steps) * size)
        for row, column in np.argwhere((value >= highest) & (value > _RIVAL * value.max()))
    ]


def _spectra(values: Grid, known: Grid) -> tuple[NDArray[np.complex64], ...]:
    return tuple(fft.rfft2(each) for each in (values, values * values, known))


@lru_cache(maxsize=4)
def _spectra_of_first(
    patch: SkinPatch, size: float, shape: tuple[int, int]
) -> tuple[NDArray[np.complex64], ...]:
    """Spectra of the coarse paint of a patch, of its squares and of where it is known."""
    step = round(size / patch.pitch)
    layer = patch.coarse[::step, ::step]
    wide = np.zeros((*shape, 2), np.float32)
    wide[: layer.shape[0], : layer.shape[1]] = layer[..., [0, 3]]
    return _spectra(wide[..., 0], wide[..., 1])


def _seen_by_first(
    first: SkinPatch,
    second: SkinPatch,
    pose: Pose,
    size: float,
    steps: NDArray,
    shape: tuple[int, int],
) -> Grid:
    """Coarse paint of the second patch, and where it is known, on the grid of the first one.

    The grid begins so many steps before the first patch. Both are taken for flat: what their
    heights shift by their difference in tilt is less than a cell.
    """
    step = max(1, round(size / second.pitch))
    layer = second.coarse[::step, ::step]
    back = np.linalg.inv(pose.rotation.as_matrix()[:2, :2])
    start = first.corner - steps * size - pose.translation[:2]
    pitch = second.pitch * step
    offset = (back @ start - second.corner) / pitch
    matrix = np.column_stack([back * (size / pitch), offset])
    rows, columns = shape
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    # One by one: OpenCV takes ten times as long for two channels together.
    warped: Any = [
        cv2.warpAffine(np.ascontiguousarray(layer[..., k]), matrix, (columns, rows), flags=flags)
        for k in (0, 3)
    ]
    seen = np.stack(warped, axis=-1)
    # What lies beyond is not known; a cell beside it is not, either.
    # Share of a cell that is known if it is.
    seen[..., 1] = seen[..., 1] > 0.99
    seen[..., 0] *= seen[..., 1]
    beyond = np.array([math.ceil(n / round(size / first.pitch)) for n in first.height.shape])
    last = beyond + 2 * steps[::-1]
    seen[last[0] :] = 0
    seen[:, last[1] :] = 0
    return seen
