"""From which depth on a dent of the smallest width would have been listed, at each place."""

from __future__ import annotations

import math
from functools import reduce

import numpy as np

from ftp_dent_ros.dents.dent import SmallestDent
from ftp_dent_ros.inspection.measuring.detection import LEAST, RATE
from ftp_dent_ros.inspection.measuring.kinds import STEEP
from ftp_dent_ros.inspection.measuring.lattice import Lattice
from ftp_dent_ros.inspection.measuring.noise import Map
from ftp_dent_ros.inspection.measuring.skin import Skin

# Full width of a Gaussian at 10 % of its depth, in its standard deviations.
_TENTH = 4.292
# Of a normal distribution, 95 %: noise hides a dent that is no deeper than what must be seen in
# half of the cases.
_SURELY = 1.645


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
    square = (width / _TENTH) ** 2
    # What windows of that resolution leave of a Gaussian, about.
    blurred = np.zeros(1) if lattice.resolution is None else np.square(lattice.resolution) / 100
    wavy = skin.uncertainty(0.0, 0.0, width)
    significant, places = skin.noise.significant(RATE), []
    for scale in skin.noise.scales[1:]:
        spread = np.hypot(skin.noise.after(scale), wavy)
        seen = np.maximum((significant + _SURELY) * spread, LEAST * settings.smallest_depth)
        places.append(seen * (square + blurred + scale**2) / square)
    spread = np.hypot(skin.noise.after(math.sqrt(square) / 2), wavy)
    known = settings.smallest_depth + _SURELY * spread
    least = np.maximum(reduce(np.minimum, places), known)
    return np.minimum(least, STEEP * width).astype(np.float32)
