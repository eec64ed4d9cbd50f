"""From which depth on a dent of the smallest width would have been listed, at each place."""

from __future__ import annotations

import math
from functools import reduce

import numpy as np
from scipy.special import ndtri

from ftp_dent_ros.cloud.response import OF_WAVES, halved
from ftp_dent_ros.dents.dent import SmallestDent
from ftp_dent_ros.inspection.measuring.detection import TENTH
from ftp_dent_ros.inspection.measuring.kinds import STEEP
from ftp_dent_ros.inspection.measuring.lattice import LEAST, Lattice
from ftp_dent_ros.inspection.measuring.noise import RATE, Map, combined
from ftp_dent_ros.inspection.measuring.skin import Skin

# Of a normal distribution, 95 %: noise hides a dent that is no deeper than what must be seen in
# half of the cases.
_SURELY = ndtri(0.95)


def findable_depth(skin: Skin, lattice: Lattice, settings: SmallestDent) -> Map:
    """Depth from which on a dent of the smallest width is listed as one, of each cell, metres.

    In 95 % of the cases. A Gaussian as wide as that must pass the test of detection, at one of
    its scales, and must be known as well as kinds ask for. It is at most what no dent of that
    width has, being no dented skin any more: so it is where no depth would do.

    Parameters
    ----------
    skin : Skin
    lattice : Lattice
    settings : SmallestDent
    """
    width = settings.smallest_width
    square = (width / TENTH) ** 2
    resolution = np.zeros(1) if lattice.resolution is None else lattice.resolution
    window = np.square(resolution / halved(OF_WAVES))

    def left(fits: int, more: float = 0.0) -> Map:
        """Of a Gaussian's depth, after fits in windows and a mean; their Gaussians add up."""
        terms = (
            (-1) ** (k + 1) * math.comb(fits, k) * square / (square + k * window + more)
            for k in range(1, fits + 1)
        )
        return reduce(np.add, terms)

    wavy, significant, places = skin.wavy(width), skin.noise.significant(RATE), []
    for scale in skin.noise.scales[1:]:
        spread = combined(skin.noise.tested(scale), wavy)
        seen = np.maximum((significant + _SURELY) * spread, LEAST * settings.smallest_depth)
        places.append(seen / left(OF_WAVES, scale**2))
    once, twice, restored = (left(OF_WAVES * order) for order in (1, 2, 3))
    spread = combined(skin.noise.after(math.sqrt(square) / 2), wavy)
    sure = restored - _SURELY * (twice - once)
    known = (settings.smallest_depth + _SURELY * spread) / np.maximum(sure, 1e-6)
    least = np.maximum(reduce(np.minimum, places), known)
    return np.minimum(least, STEEP * width).astype(np.float32)
