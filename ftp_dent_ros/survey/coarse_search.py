"""Where the paint of one patch may lie on another's: correlation over all shifts at once.

Source of the correlation of partly known images: D. Padfield, IEEE Transactions on Image
Processing 21, 2706 (2012).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import fft

from ftp_dent_ros.pose import Pose
from ftp_dent_ros.survey.alignment import moved
from ftp_dent_ros.survey.patch import Patch

# Of the cells that are correlated, metres: marks are a few millimetres wide.
_CELL = 0.003
# Standard deviations of the guess within which is looked for, and the least and most, metres.
_WITHIN, _LEAST_REACH, _MOST_REACH = 4.0, 0.006, 0.2
# About the normal: what moves no mark farther than it is wide, radians.
_TURN = 0.008
# Of the smaller image, that has to overlap.
_LEAST_OVERLAP = 0.1
# Correlation that leaves no doubt that the turn is nearly right.
_PLAIN = 0.6
# A peak's correlation by the highest one's from which on both are looked at, and how many.
_RIVAL, _MOST_PEAKS = 0.75, 3


@dataclass(frozen=True, eq=False)
class _Image:
    values: NDArray[np.float32]
    known: NDArray[np.float32]
    spectra: tuple[NDArray[np.complex64], ...] = ()


def candidates(
    first: Patch,
    second: Patch,
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
    found: list[tuple[float, Pose]] = []
    for turn in turns:
        if found and found[0][0] > _PLAIN and abs(turn) > _TURN:
            break
        pose = moved(guess, np.array([0, 0, 0, 0, 0, turn]), centre)
        for height, shift in _peaks(first, second, pose, reach):
            step = np.array([*shift, 0, 0, 0, 0])
            found.append((height, moved(pose, step, centre)))
        found.sort(key=lambda each: -each[0])
    kept: list[tuple[float, Pose]] = []
    for height, pose in found:
        place = pose.apply(centre)
        if height < _RIVAL * found[0][0] or len(kept) == _MOST_PEAKS:
            break
        if all(np.linalg.norm(other.apply(centre) - place) > 2 * _CELL for _, other in kept):
            kept.append((height, pose))
    return [pose for _, pose in kept]


def _peaks(first: Patch, second: Patch, pose: Pose, reach: NDArray) -> list[tuple[float, NDArray]]:
    """Correlations and shifts of the best maxima within reach."""
    # Both on a grid along the first patch's axes, the second one's as its tilt shows it.
    size = max(1, round(_CELL / first.pitch)) * first.pitch
    there = _on_grid(second, size, pose)
    if there is None:
        return []
    (image, corner), (still, still_corner) = there, _whole(first, size)
    shape = tuple(a + b - 1 for a, b in zip(still.values.shape, image.values.shape, strict=True))
    fast = tuple(fft.next_fast_len(n, real=True) for n in shape)
    ones = [fft.rfft2(each, fast) for each in (still.values, still.values**2, still.known)]
    others = [fft.rfft2(each, fast) for each in (image.values, image.values**2, image.known)]

    def correlated(a: int, b: int) -> NDArray[np.float32]:
        return np.asarray(fft.irfft2(ones[a] * np.conj(others[b]), fast))

    count = correlated(2, 2)
    least = _LEAST_OVERLAP * min(still.known.sum(), image.known.sum())
    power = np.sqrt(np.maximum(correlated(1, 2) * correlated(2, 1), 1e-12))
    # Of two that are as alike, the one with more in common.
    value = np.where(count > max(least, 1), correlated(0, 0) / power, 0) * np.sqrt(
        np.clip(count / count.max(), 0, 1)
    )
    # At index k the second image's corner lies on the first one's cell k.
    nominal = (corner - still_corner) / size
    peaks = []
    steps = np.ceil(reach / size).astype(int)
    base = np.rint(nominal).astype(int)
    window = np.array(
        [
            [
                value[r % fast[0], c % fast[1]]
                for c in range(base[0] - steps[0], base[0] + steps[0] + 1)
            ]
            for r in range(base[1] - steps[1], base[1] + steps[1] + 1)
        ]
    )
    highest = cv2.dilate(window.astype(np.float32), np.ones((5, 5), np.uint8))
    at = np.argwhere((window >= highest) & (window > 0))
    for row, column in at:
        cell = np.array([column - steps[0] + base[0], row - steps[1] + base[1]])
        peaks.append((float(window[row, column]), (cell - nominal) * size))
    peaks.sort(key=lambda each: -each[0])
    return peaks[:_MOST_PEAKS]


@lru_cache(maxsize=8)
def _whole(patch: Patch, size: float) -> tuple[_Image, NDArray[np.float64]]:
    """Coarse paint of a patch on a coarser grid of its own, and that grid's corner."""
    step = round(size / patch.pitch)
    layer = patch.coarse[::step, ::step]
    return _Image(layer[..., 0], layer[..., 3]), patch.corner


def _on_grid(patch: Patch, size: float, pose: Pose) -> tuple[_Image, NDArray[np.float64]] | None:
    """Coarse paint of a patch on a grid along another's axes, seen along that one's normal."""
    points, paint = _cells(patch, size)
    if not len(points):
        return None
    place = pose.apply(points)[:, :2]
    corner = np.floor(place.min(axis=0) / size) * size
    cell = np.rint((place - corner) / size).astype(int)
    columns, rows = cell.max(axis=0) + 1
    flat = cell[:, 1] * columns + cell[:, 0]
    count = np.bincount(flat, minlength=rows * columns).reshape(rows, columns)
    total = np.bincount(flat, paint, rows * columns).reshape(rows, columns)
    known = count > 0
    values = np.where(known, total / np.maximum(count, 1), 0).astype(np.float32)
    return _Image(values, known.astype(np.float32)), corner


@lru_cache(maxsize=8)
def _cells(patch: Patch, size: float) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
    """Points of every few cells with coarse paint, shape (n, 3), and the paint."""
    step = max(1, int(size / patch.pitch))
    usable = (patch.coarse[::step, ::step, 3] > 0) & patch.known[::step, ::step]
    row, column = np.nonzero(usable)
    row, column = row * step, column * step
    return patch.points(row, column), patch.coarse[row, column, 0]
