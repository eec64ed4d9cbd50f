"""A skin's waviness: what its contour does over many widths of the smallest dent."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
import scipy.fft
from numpy.typing import NDArray

from ftp_dent_ros.dents.dent import Waviness
from ftp_dent_ros.inspection.measuring.contour import TUKEY, biweight
from ftp_dent_ros.inspection.measuring.lattice import Lattice
from ftp_dent_ros.inspection.measuring.noise import Map, Mask, median_of
from ftp_dent_ros.robust import FITS, NORMAL_SPREAD

#: The relief takes half of waves so many smallest widths long, and nearly all of longer ones.
CUTOFF = 6.0
# Cells of the relief's grid to the smallest width.
_GRID = 2.0
# Steps towards the fixed point between new weights.
_TURNS = 10
#: Smallest widths about a dent within which its edge runs out. Holes that show a fit's error are
# so wide to each side.
AROUND = 1.5

Field = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Relief:
    """Depths below a contour of the cells of a lattice.

    Attributes
    ----------
    heights, lacks : ndarray, shape (rows, columns), float32
        Depths, and how much more the waves may be, which the fit follows part of the way, metres.
    amplitude : float
        Of the sine with the same root mean square, metres.
    under_hole : float
        How far it is off in the middle of holes `hole` wide, root mean square, metres; as much as
        the waves where too little of the skin is bare to cut any.
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
        # The error of an interpolated curve goes with the square of the gap, up to all of it.
        return min(self.under_hole * (width / self.hole) ** 2, self.amplitude)


def relief_of(deviation: Map, bare: Mask, lattice: Lattice, smallest: float) -> Relief:
    """Smooth surface through the bare skin's deviations.

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
    fit = _Plate(deviation, bare, lattice, smallest)
    smooth = fit.through(fit.weight)
    # At the cutoff the fit leaves half of a wave, and takes half of that when it is fitted again.
    again = fit.passed(smooth)
    again += fit.passed(smooth - again)
    fine, lacks = (
        np.asarray(cv2.resize(each, deviation.shape[::-1], interpolation=cv2.INTER_CUBIC))
        for each in (np.float32(smooth), np.float32(2 * np.abs(smooth - again)))
    )
    amplitude = math.sqrt(2) * float(fine[np.isfinite(deviation)].std())
    hole = 2 * AROUND * smallest
    return Relief(fine, lacks, amplitude, fit.error_under(hole, smooth), hole)


class _Plate:
    """A plate's fit to the means of a coarse grid."""

    def __init__(self, deviation: Map, bare: Mask, lattice: Lattice, smallest: float) -> None:
        rows, columns = deviation.shape
        across, down = lattice.cells(smallest / _GRID)
        size = max(8, round(columns / max(across, 1))), max(8, round(rows / max(down, 1)))
        weight = cv2.resize(bare.astype(np.float32), size, interpolation=cv2.INTER_AREA)
        total = cv2.resize(
            np.where(bare, deviation, np.float32(0)), size, interpolation=cv2.INTER_AREA
        )
        self.values = np.asarray(total / np.maximum(weight, 1e-3), float)
        self.weight = np.where(weight < 0.3, 0.0, weight)
        extent = columns * lattice.spacing[0], rows * lattice.spacing[1]
        self._spacing = extent[0] / size[0], extent[1] / size[1]
        x, y = (np.arange(n) / (2 * length) for n, length in zip(size, extent, strict=True))
        # Of each cosine half is left at the cutoff; it falls with the fourth power.
        self._penalty = 1 / (1 + (np.hypot(x, y[:, None]) * CUTOFF * smallest) ** 4)

    def passed(self, values: Field) -> Field:
        """What the penalty leaves of a field."""
        spectrum = scipy.fft.dctn(values, norm='ortho')
        return np.asarray(scipy.fft.idctn(spectrum * self._penalty, norm='ortho'))

    def through(self, weight: Field) -> Field:
        """A fit and one of what it leaves (Tukey's twicing), which takes waves more sharply."""
        smooth = self._fitted(self.values, weight)
        return smooth + self._fitted(self.values - smooth, weight)

    def error_under(self, hole: float, smooth: Field) -> float:
        """How far off a fit is in the middle of holes cut where the skin is bare, metres."""
        y, x = (
            step * (np.arange(n) + 0.5)
            for step, n in zip(self._spacing[::-1], self.values.shape, strict=True)
        )
        period = 2 * hole
        off_x, off_y = (np.abs(each % period - period / 2) for each in (x, y))
        distance = np.hypot(off_x, off_y[:, None])
        # Some cell of the grid is so near the middle of each hole.
        middle = (distance <= math.hypot(*self._spacing) / 2) & (self.weight > 0.9)
        if not middle.any():
            return math.inf
        # Against the fit without holes: the noise of one cell is no error of a fit.
        missed = self.through(np.where(distance < hole / 2, 0.0, self.weight)) - smooth
        return NORMAL_SPREAD * float(np.median(np.abs(missed[middle])))

    def _fitted(self, values: Field, weight: Field) -> Field:
        """Penalised fit, with weights that leave outliers out; the fixed point is sped up."""
        smooth, robust = np.zeros_like(values), weight
        for _ in range(FITS):
            before = smooth
            for turn in range(_TURNS):
                # Nesterov's acceleration.
                ahead = smooth + turn / (turn + 3) * (smooth - before)
                before, smooth = smooth, self.passed(robust * (values - ahead) + ahead)
            left = np.abs(values - smooth)
            spread = NORMAL_SPREAD * median_of(left[weight > 0]) + 1e-9
            robust = weight * biweight(left / (TUKEY * spread))
        return smooth


def waviness_of(relief: Relief, mask: Mask, lattice: Lattice) -> Waviness:
    """Amplitude and wavelength of a skin's relief."""
    inside = relief.heights[mask].astype(float)
    values = np.zeros(mask.shape)
    values[mask] = inside - inside.mean()
    size = 2 * np.array(mask.shape)
    power = np.abs(scipy.fft.rfft2(values, size)) ** 2
    at = np.unravel_index(np.argmax(power), power.shape)
    down = scipy.fft.fftfreq(size[0], lattice.spacing[1])[at[0]]
    across = scipy.fft.rfftfreq(size[1], lattice.spacing[0])[at[1]]
    longest = 2 * math.hypot(*(np.array(mask.shape) * lattice.spacing[::-1]))
    wavelength = 1 / max(math.hypot(down, across), 1 / longest)
    area = float(mask.sum()) * math.prod(lattice.spacing)
    return Waviness(relief.amplitude, wavelength, area)
