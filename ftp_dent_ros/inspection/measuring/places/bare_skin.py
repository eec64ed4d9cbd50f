"""The final contour of a panel, from its skin without dents, and the noise about it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.dents.dent import SmallestDent
from ftp_dent_ros.inspection.measuring.skin.contour import Contour
from ftp_dent_ros.inspection.measuring.skin.contour_fit import refined
from ftp_dent_ros.inspection.measuring.skin.lattice import Lattice
from ftp_dent_ros.inspection.measuring.skin.noise import Noise, measured_noise, smoothed
from ftp_dent_ros.inspection.measuring.skin.panels import Panel
from ftp_dent_ros.inspection.measuring.skin.waviness import Relief, is_wavy, relief_of
from ftp_dent_ros.robust import NORMAL_SPREAD, median

Mask = NDArray[np.bool_]
Map = NDArray[np.float32]

# Side of the squares whose means count as independent, in smallest widths.
_SQUARE = 1.0
# Cells around a dent in which its edge may run out.
_AROUND = 15
# Cells around what may be a dent that the second contour leaves out.
_FARTHER = 25
# Of the relief: of all of the skin with weights alone, then with what they found left out.
_PASSES = 2
_LEAST = 1e-6
# Squares that a contour is fitted to.
_FEWEST = 30


@dataclass(frozen=True, eq=False)
class BareSkin:
    """A panel as it was before its dents.

    Attributes
    ----------
    contour : Contour
    wide : Contour
        The same from skin farther off the dents: how they differ tells what the contour follows.
    relief : Relief or None
        Waviness, to be added to the contour.
    noise : Noise
        About both.
    maps : list of ndarray, shape (rows, columns), float32
        Deviation smoothed at the noise's scales but for the first, 0.
    area : float
        Of the panel, as far as it is measured, square metres.
    """

    contour: Contour
    wide: Contour
    relief: Relief | None
    noise: Noise
    maps: list[Map]
    area: float

    def uncertainty(self, x: float, y: float, width: float) -> float:
        """Standard uncertainty of the skin under the middle of a dent, metres."""
        at = np.float64(x), np.float64(y)
        fitted = float(self.contour.uncertainty(*at))
        followed = 0.0
        if self.wide is not self.contour:
            followed = float(self.contour.height(*at) - self.wide.height(*at))
        wavy = 0.0 if self.relief is None else self.relief.uncertainty(width)
        return math.sqrt(fitted**2 + followed**2 + wavy**2)


def bare_skin(lattice: Lattice, panel: Panel, seams: Mask, settings: SmallestDent) -> BareSkin:
    """The contour of a panel, its waviness, the noise about them, and what departs from them."""
    scales = tuple(settings.smallest_width * share for share in (0.2, 0.5, 1.0))
    contour = panel.contour
    usable = panel.mask & ~seams
    deviation = _deviation(contour, lattice, panel.mask)
    bare = usable & (np.abs(deviation) < panel.tolerance) if panel.is_met else usable
    known = np.isfinite(deviation)
    maps = [smoothed(deviation, known, lattice.cells(scale)) for scale in scales]
    noise = measured_noise(deviation, maps, bare, lattice, scales)
    off = _off(maps, noise, settings) if panel.is_met else np.zeros_like(usable)
    bare = usable & ~off
    contour = _fitted(contour, lattice, bare, panel.tolerance, settings)
    wider = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (_FARTHER, _FARTHER))
    farther = usable & ~(cv2.dilate(off.view(np.uint8), wider) > 0)
    wide = contour
    if off.any():
        wide = _fitted(contour, lattice, farther, panel.tolerance, settings)
    before, deviation = deviation, _deviation(contour, lattice, panel.mask)
    # Contours are too smooth for the smoothing to change their difference.
    maps = [smooth + (deviation - before) for smooth in maps]
    noise = measured_noise(deviation, maps, bare, lattice, scales)
    relief = None
    # Where no contour is met, what is wide is as likely the panel's own shape as a dent.
    if not panel.is_met or is_wavy(noise, settings):
        # Crests of waves stray from the contour as dents do: of the relief, its weights tell.
        bare = usable
        for _ in range(_PASSES):
            found = relief_of(deviation, bare & known, lattice, settings.smallest_width)
            if found is None:
                break
            relief = found
            flat = deviation - relief.heights
            maps = [smoothed(flat, known, lattice.cells(scale)) for scale in scales]
            noise = measured_noise(flat, maps, bare, lattice, scales)
            bare = usable & ~_off(maps, noise, settings, relief.lacks)
    area = np.count_nonzero(panel.mask) * lattice.spacing[0] * lattice.spacing[1]
    return BareSkin(contour, wide, relief, noise, maps, area)


def _off(maps: list[Map], noise: Noise, settings: SmallestDent, lacks: Map | float = 0.0) -> Mask:
    """Surroundings of what is deep enough to be a dent, as far as it strays from the contour.

    By more than the contour `lacks`, metres.
    """
    strays = np.zeros(maps[0].shape, bool)
    deep = np.zeros(maps[0].shape, np.uint8)
    with np.errstate(invalid='ignore'):
        for smooth, scale in zip(maps, noise.scales[1:], strict=True):
            spread = noise.after(scale)
            off = np.abs(smooth) - lacks
            strays |= off > np.maximum(2 * spread, 0.02 * settings.smallest_depth)
            deep |= off > np.maximum(5 * spread, settings.smallest_depth / 4)
    around = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (_AROUND, _AROUND))
    return strays & (cv2.dilate(deep, around) > 0)


def _fitted(
    contour: Contour, lattice: Lattice, bare: Mask, tolerance: float, settings: SmallestDent
) -> Contour:
    """The contour through the bare skin; as it is, within its tolerance, where that is little."""
    points = _squares(lattice, bare, settings)
    if len(points) < _FEWEST:
        covariance = np.zeros((contour.terms, contour.terms))
        covariance[0, 0] = (tolerance / contour.scale) ** 2
        return replace(contour, covariance=covariance)
    _, _, left = contour.deviation(points)
    noise = max(NORMAL_SPREAD * median(np.abs(left)), _LEAST)
    return refined(contour, points, noise)


def _squares(lattice: Lattice, bare: Mask, settings: SmallestDent) -> NDArray[np.float32]:
    """Means of the bare points in squares, shape (n, 3)."""
    rows, columns = bare.shape
    across, down = lattice.cells(_SQUARE * settings.smallest_width)
    size = max(2, columns // max(1, round(across))), max(2, rows // max(1, round(down)))
    share = cv2.resize(bare.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    kept = cv2.copyTo(lattice.points, bare.view(np.uint8))
    total = cv2.resize(kept, size, interpolation=cv2.INTER_AREA)
    enough = share > 0.35
    return np.asarray(total[enough] / share[enough][:, None], np.float32)


def _deviation(contour: Contour, lattice: Lattice, part: Mask) -> Map:
    deviation = contour.depth(lattice.points)
    deviation[~(part & lattice.valid)] = np.nan
    return deviation
