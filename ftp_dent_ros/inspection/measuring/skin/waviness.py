"""A skin's waviness: what its contour does over many widths of the smallest dent."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
import scipy.fft
from numpy.typing import NDArray

from ftp_dent_ros.dents.dent import SmallestDent, Waviness
from ftp_dent_ros.inspection.measuring.skin.lattice import Lattice
from ftp_dent_ros.inspection.measuring.skin.noise import Map, Mask, Noise, median_of
from ftp_dent_ros.inspection.measuring.skin.robust_polynomial import basis
from ftp_dent_ros.robust import NORMAL_SPREAD

#: The relief takes half of waves so many smallest widths long, and nearly all of longer ones.
CUTOFF = 6.0
# Cells of the relief's grid to the smallest width.
_GRID = 2.0
# Rounds to the fixed point, and of them those between new weights.
_ROUNDS, _WEIGHTED = 50, 10
_TUKEY = 4.7
# At the cutoff the fit leaves half of a wave, and takes half of that when it is fitted again.
_LACKS = 2.0
# Waviness is evident where means over the smallest width stray nearly as much as single cells,
# and a relief leaves less than this part of that.
_SLOW = 0.6
_LEFT = 0.5
_FEWEST = 30
_MOMENTUM = 0.8
# Holes that tell the fit's error: in smallest widths, and from one to the next in holes.
_HOLE, _APART = 2.0, 3.0
# Terms of the second degree.
_QUADRIC = 6
# Waviness that matters, in smallest depths.
_LEAST = 0.04

Field = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Relief:
    """Depths below a contour of the cells of a lattice.

    Attributes
    ----------
    heights : ndarray, shape (rows, columns), float32
        Metres.
    lacks : ndarray, shape (rows, columns), float32
        How much more the waves may be, which the fit follows part of the way, metres.
    amplitude : float
        Of the sine with the same root mean square, but for what a quadric takes of it, metres.
    under_hole : float
        How far it is off in the middle of holes `hole` wide, root mean square, metres; infinite
        where too little of the skin is bare to cut any.
    hole : float
        Metres.
    """

    heights: Map
    lacks: Map
    amplitude: float
    under_hole: float
    hole: float

    def uncertainty(self, width: float) -> float:
        """Standard uncertainty under the middle of a dent, metres."""
        # The error of an interpolated curve grows with the square of the gap, up to all of it.
        return min(self.under_hole * max(width / self.hole, 1.0) ** 2, self.amplitude)

    def at_points(self, block: int, shape: tuple[int, ...]) -> Map:
        """Depths of the relief at the points of the cloud, shape `shape`."""
        rows, columns = self.heights.shape
        size = columns * block, rows * block
        fine = cv2.resize(self.heights, size, interpolation=cv2.INTER_CUBIC)
        left = (0, max(shape[0] - size[1], 0)), (0, max(shape[1] - size[0], 0))
        return np.asarray(np.pad(fine, left, mode='edge'), np.float32)


def is_wavy(noise: Noise, settings: SmallestDent) -> bool:
    """Whether the bare skin strays over long distances, more than its noise can."""
    slow = noise.common[-1]
    return bool(slow > max(_SLOW * noise.common[0], _LEAST * settings.smallest_depth))


def relief_of(deviation: Map, bare: Mask, lattice: Lattice, smallest: float) -> Relief | None:
    """Smooth surface through the bare skin's deviations; None if it does not explain them.

    The smoothest one in the sense of a bent plate, whose weights leave dents out: a penalised
    least-squares fit by the discrete cosine transform (Garcia, Comput. Stat. Data Anal. 54,
    1167, 2010).

    Parameters
    ----------
    deviation : ndarray, shape (rows, columns), float32
        Metres; NaN where there is no skin.
    bare : ndarray, shape (rows, columns), bool
        Skin without what may be dents.
    lattice : Lattice
    smallest : float
        Width of the smallest dent, metres.
    """
    rows, columns = deviation.shape
    across, down = lattice.cells(smallest / _GRID)
    size = max(8, round(columns / max(across, 1))), max(8, round(rows / max(down, 1)))
    weight = cv2.resize(bare.astype(np.float32), size, interpolation=cv2.INTER_AREA).astype(float)
    total = cv2.resize(
        np.where(bare, deviation, np.float32(0)), size, interpolation=cv2.INTER_AREA
    )
    values = total / np.maximum(weight, 1e-3)
    weight[weight < 0.3] = 0
    spacing = columns * lattice.spacing[0] / size[0], rows * lattice.spacing[1] / size[1]
    penalty = _penalty(size, spacing, CUTOFF * smallest)
    smooth = _fitted_twice(values, weight, penalty)
    left = np.abs(values - smooth)[weight > 0.9]
    before = np.abs(values)[weight > 0.9]
    if len(left) < _FEWEST or median_of(left) > _LEFT * median_of(before):
        return None
    again = _passed(smooth, penalty)
    again += _passed(smooth - again, penalty)
    fine, lacks = (
        np.asarray(
            cv2.resize(each.astype(np.float32), (columns, rows), interpolation=cv2.INTER_CUBIC),
            np.float32,
        )
        for each in (smooth, _LACKS * np.abs(smooth - again))
    )
    amplitude = math.sqrt(2) * float(_beside_quadric(smooth, weight > 0).std())
    hole = _HOLE * smallest
    return Relief(
        fine,
        lacks,
        amplitude,
        _under_holes(values, weight, penalty, spacing, hole),
        hole,
    )


def _beside_quadric(values: Field, inside: Mask) -> Field:
    """What a quadric leaves of a field, shape (n,): a contour through all of the waves."""
    rows, columns = np.nonzero(inside)
    x, y = (at / length for at, length in zip((columns, rows), inside.shape[::-1], strict=True))
    terms, found = basis(x, y, _QUADRIC), values[inside]
    return np.asarray(found - terms @ np.linalg.lstsq(terms, found, rcond=None)[0], float)


def _fitted_twice(values: Field, weight: Field, penalty: Field) -> Field:
    """A fit and one of what it leaves (Tukey's twicing), which take waves more sharply apart."""
    smooth = _fitted(values, weight, penalty)
    return smooth + _fitted(values - smooth, weight, penalty)


def _fitted(values: Field, weight: Field, penalty: Field) -> Field:
    """Penalised fit, with weights that leave outliers out; the fixed point is sped up."""
    smooth = np.zeros_like(values)
    robust, speed = weight, np.zeros_like(values)
    for turn in range(_ROUNDS):
        if turn % _WEIGHTED == 0 and turn:
            left = np.abs(values - smooth)
            spread = NORMAL_SPREAD * median_of(left[weight > 0]) + 1e-9
            # Of waves down to the cutoff the fit lacks no more than this: they are no outliers.
            lacks = _LACKS * np.abs(smooth - _passed(smooth, penalty))
            ratio = np.minimum(np.maximum(left - lacks, 0) / (_TUKEY * spread), 1)
            robust = weight * np.square(1 - ratio * ratio)
            speed = np.zeros_like(smooth)
        ahead = smooth + _MOMENTUM * speed
        step = _passed(robust * (values - ahead) + ahead, penalty)
        speed, smooth = step - smooth, step
    return smooth


def _passed(values: Field, penalty: Field) -> Field:
    """What the penalty leaves of a field."""
    return np.asarray(
        scipy.fft.idctn(scipy.fft.dctn(values, norm='ortho') * penalty, norm='ortho')
    )


def _under_holes(
    values: Field, weight: Field, penalty: Field, spacing: tuple[float, float], hole: float
) -> float:
    """How far a fit is off in the middle of holes cut where the skin is bare, metres."""
    x, y = np.meshgrid(
        np.arange(values.shape[1]) * spacing[0], np.arange(values.shape[0]) * spacing[1]
    )
    period = _APART * hole
    off_x, off_y = (x + period / 2) % period - period / 2, (y + period / 2) % period - period / 2
    distance = np.hypot(off_x, off_y)
    cut = np.where(distance < hole / 2, 0.0, weight)
    middle = (distance < hole / 6) & (weight > 0.9)
    if middle.sum() < _FEWEST // 4:
        return math.inf
    missed = (_fitted_twice(values, cut, penalty) - values)[middle]
    return NORMAL_SPREAD * float(np.median(np.abs(missed)))


def waviness_of(relief: Relief, mask: Mask, lattice: Lattice) -> Waviness:
    """Amplitude and wavelength of a panel's relief."""
    values = np.where(mask, relief.heights, 0).astype(float)
    inside = values[mask]
    inside = inside - inside.mean()
    values[mask] = inside
    power = np.abs(scipy.fft.rfft2(values, (2 * values.shape[0], 2 * values.shape[1]))) ** 2
    down = scipy.fft.fftfreq(2 * values.shape[0], lattice.spacing[1])
    across = scipy.fft.rfftfreq(2 * values.shape[1], lattice.spacing[0])
    at = np.unravel_index(np.argmax(power), power.shape)
    frequency = math.hypot(down[at[0]], across[at[1]])
    area = float(mask.sum()) * lattice.spacing[0] * lattice.spacing[1]
    longest = math.hypot(
        values.shape[0] * lattice.spacing[1], values.shape[1] * lattice.spacing[0]
    )
    wavelength = 1 / frequency if frequency > 0 else longest
    return Waviness(relief.amplitude, wavelength, area)


def _penalty(size: tuple[int, int], spacing: tuple[float, float], cutoff: float) -> Field:
    """Gain of each cosine: 1/2 at the cutoff wavelength, falling with its fourth power."""
    x = np.arange(size[0]) / (2 * size[0] * spacing[0])
    y = np.arange(size[1]) / (2 * size[1] * spacing[1])
    frequency = np.hypot(x[None], y[:, None])
    return 1 / (1 + (frequency * cutoff) ** 4)
