"""A skin as it was before its dents: its contour, its waviness, and the noise about them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.dents.dent import COVERAGE, SmallestDent
from ftp_dent_ros.inspection.measuring.contour import Contour, refined
from ftp_dent_ros.inspection.measuring.gaps import filled
from ftp_dent_ros.inspection.measuring.lattice import LEAST, WIDE, Lattice
from ftp_dent_ros.inspection.measuring.noise import (
    SURE,
    Map,
    Mask,
    Noise,
    measured_noise,
    smoother,
)
from ftp_dent_ros.inspection.measuring.segmentation import Segment
from ftp_dent_ros.inspection.measuring.waviness import AROUND, Relief, relief_of
from ftp_dent_ros.robust import deviation as spread_of
from ftp_dent_ros.robust import median

# Gaussians that dents are looked for with, in smallest widths at 10 % of the depth: a fifth is a
# half narrower than the smallest dent's own, and one is four times as wide.
_SCALES = 0.2, 0.5, 1.0
# Of what strays after a mean over half of the smallest width, a relief leaves this of noise and
# waves of twice its variance; of noise alone 0.7.
_LEFT = 0.4
# Squares that a contour is fitted to.
_FEWEST = 30


@dataclass(frozen=True, eq=False)
class Skin:
    """A segment as it was before its dents.

    Attributes
    ----------
    contour : Contour
    relief : Relief or None
        Waviness, to be added to the contour.
    noise : Noise
        About both.
    deviation : ndarray, shape (rows, columns), float32
        Depths below both, metres; NaN elsewhere.
    maps : list of ndarray, shape (rows, columns), float32
        The same, smoothed at the noise's scales but for the first, 0.
    usable : ndarray, shape (rows, columns), bool
        Cells of the segment, without those at seams.
    reach : int
        Cells across which a gap is filled.
    """

    contour: Contour
    relief: Relief | None
    noise: Noise
    deviation: Map
    maps: list[Map]
    usable: Mask
    reach: int

    @cached_property
    def bridged(self) -> tuple[Map, Map, Mask]:
        """Depths with what lies over gaps, 0 elsewhere; how far that is in doubt; and the gaps."""
        known = self.usable & np.isfinite(self.deviation)
        return filled(np.where(known, self.deviation, np.float32(0)), known, self.reach)

    def wavy(self, width: float) -> float:
        """Standard uncertainty of the waves under the middle of a dent, metres."""
        return 0.0 if self.relief is None else self.relief.uncertainty(width)

    def uncertainty(self, x: float, y: float, width: float) -> float:
        """Standard uncertainty of the skin under the middle of a dent, metres."""
        # What is left out of the waves is wider than a dent by its surroundings.
        wavy = 0.0 if self.relief is None else self.relief.uncertainty(width + self.relief.hole)
        return math.hypot(self.contour.uncertainty(x, y), wavy)


def bare_skin(lattice: Lattice, part: Segment, seams: Mask, settings: SmallestDent) -> Skin:
    """The contour of a segment, its waviness, the noise about them, and what departs from them."""
    usable, known = part.mask & ~seams, part.mask & lattice.valid
    scales = tuple(settings.smallest_width * share for share in _SCALES)
    means = [smoother(known, lattice.cells(scale)) for scale in scales]
    reach = round(WIDE * settings.smallest_width / max(lattice.spacing))

    def about(
        contour: Contour, relief: Relief | None, bare: Mask, within: float = math.inf
    ) -> Skin:
        """What departs from a contour and a relief, and the noise of what is bare and near."""
        deviation = contour.depth(lattice.points)
        deviation = deviation if relief is None else deviation - relief.heights
        deviation = np.where(known, deviation, np.float32(np.nan))
        bare, maps = bare & (np.abs(deviation) < within), [mean(deviation) for mean in means]
        noise = measured_noise(deviation, maps, bare, lattice, scales)
        return Skin(contour, relief, noise, deviation, maps, usable, reach)

    bare = usable
    if part.is_met:
        bare = bare & ~_off(about(part.contour, None, bare, part.tolerance), lattice, settings)
    contour = _fitted(part, lattice, bare, settings)
    skin = about(contour, None, bare)
    # Waves that may feign what a mean has of the smallest dent matter, if they stray more than
    # noise, of which half as wide a mean has twice as much. And where no contour is met, what is
    # wide is as likely the skin's own shape as a dent.
    usual = median(skin.noise.stated)
    half, wide = (float(skin.noise.after(scale, usual)) for scale in scales[1:])
    if part.is_met and wide < max(half / math.sqrt(2), LEAST * settings.smallest_depth / SURE):
        return skin
    # Crests of waves stray from the contour as dents do: weights keep them in the relief.
    bare = seen = usable & np.isfinite(skin.deviation)
    for _ in range(2):
        relief = relief_of(skin.deviation, bare, lattice, settings.smallest_width)
        wavy = about(contour, relief, bare)
        if wavy.noise.after(scales[1], usual) > _LEFT * half:
            return skin
        bare = seen & ~_off(wavy, lattice, settings)
    return wavy


def _off(skin: Skin, lattice: Lattice, settings: SmallestDent) -> Mask:
    """Surroundings of what is deep enough to be a dent, as far as it strays from the skin."""
    strays, deep = (np.zeros(skin.deviation.shape, bool) for _ in range(2))
    lacks = 0.0 if skin.relief is None else skin.relief.lacks
    for smooth, scale in zip(skin.maps, skin.noise.scales[1:], strict=True):
        spread, off = skin.noise.after(scale), np.nan_to_num(np.abs(smooth) - lacks)
        strays |= off > COVERAGE * spread
        deep |= off > np.maximum(SURE * spread, LEAST * settings.smallest_depth)
    wide = 2 * round(AROUND * settings.smallest_width / max(lattice.spacing)) + 1
    around = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (wide, wide))
    return strays & (cv2.dilate(deep.view(np.uint8), around) > 0)


def _fitted(part: Segment, lattice: Lattice, bare: Mask, settings: SmallestDent) -> Contour:
    """The contour through the bare skin; as it is, within its tolerance, where that is little."""
    contour, points = part.contour, _squares(lattice, bare, settings)
    if len(points) < _FEWEST:
        covariance = np.zeros((6, 6))
        covariance[0, 0] = (part.tolerance / contour.scale) ** 2
        return replace(contour, covariance=covariance)
    noise = max(spread_of(contour.depth(points)), 1e-6)
    return refined(contour, points, noise)


def _squares(lattice: Lattice, bare: Mask, settings: SmallestDent) -> NDArray[np.float32]:
    """Means of the bare points in squares as wide as the smallest dent, shape (n, 3)."""
    rows, columns = bare.shape
    across, down = lattice.cells(settings.smallest_width)
    size = max(2, columns // max(1, round(across))), max(2, rows // max(1, round(down)))
    share = cv2.resize(bare.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    total = cv2.resize(
        cv2.copyTo(lattice.points, bare.view(np.uint8)), size, interpolation=cv2.INTER_AREA
    )
    enough = share > 0.35
    return np.asarray(total[enough] / share[enough][:, None], np.float32)
