"""Where the skin departs from its contour beyond the noise: one test at several scales."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from ftp_dent_ros.dents.dent import COVERAGE, SmallestDent
from ftp_dent_ros.inspection.measuring.lattice import LEAST, LEVEL, Lattice
from ftp_dent_ros.inspection.measuring.noise import RATE, Mask, combined, smoother
from ftp_dent_ros.inspection.measuring.skin import Skin
from ftp_dent_ros.robust import median

#: Full width of a Gaussian at 10 % of its depth, in its standard deviations.
TENTH = 2 * math.sqrt(2 * math.log(10))


@dataclass(frozen=True, eq=False)
class Place:
    """Connected cells that depart from a skin.

    Attributes
    ----------
    sign : int
        1 inward, -1 outward.
    window : tuple of 2 slices
        The rows and columns of the lattice that hold it.
    mask : ndarray, shape (rows, columns), bool
        Its cells in the window.
    significance : float
        Largest departure over the noise, of all scales.
    """

    sign: int
    window: tuple[slice, slice]
    mask: Mask
    significance: float


def find_places(skin: Skin, lattice: Lattice, settings: SmallestDent) -> list[Place]:
    """Places of one skin where a smoothed deviation exceeds its noise.

    Gaps are filled, and are as uncertain as what fills them.

    Parameters
    ----------
    skin : Skin
    lattice : Lattice
    settings : SmallestDent
    """
    bridged, doubt, gaps = skin.bridged
    known = skin.usable & np.isfinite(skin.deviation)
    least = settings.smallest_depth
    significant = skin.noise.significant(RATE)
    evidence, height = np.zeros((2, *known.shape), np.float32), np.zeros(known.shape, np.float32)
    base, lowest = np.full(known.shape, np.inf), np.array(np.inf)
    stated = skin.noise.stated, median(skin.noise.stated[known])
    for smooth, scale in zip(skin.maps, skin.noise.scales[1:], strict=True):
        wavy = skin.wavy(TENTH * scale)
        spread, usual = (combined(skin.noise.tested(scale, each), wavy) for each in stated)
        unsure = spread
        if gaps.any():
            mean = smoother(known | gaps, lattice.cells(scale))
            smooth, unsure = mean(bridged), combined(spread, mean(doubt))
        smooth = np.where(known | gaps, np.nan_to_num(smooth), np.float32(0))
        for side, sign in enumerate((1, -1)):
            deep = sign * smooth
            np.fmax(evidence[side], deep / unsure, out=evidence[side], where=deep > LEAST * least)
        # Wider means have less noise, and more of what is not known of the waves below a dent.
        if np.maximum(usual, least / significant) < lowest:
            base, height, lowest = spread, smooth, usual
    found = []
    for side, sign in enumerate((1, -1)):
        above = sign * height > np.maximum(COVERAGE * base, LEVEL * least)
        _, labels, stats, _ = cv2.connectedComponentsWithStats(above.view(np.uint8))
        for index in np.unique(labels[(evidence[side] >= significant) & above]):
            left, top, width, rows, _ = stats[index]
            window = slice(top, top + rows), slice(left, left + width)
            mask = labels[window] == index
            found.append(Place(sign, window, mask, float(evidence[side][window][mask].max())))
    return found
