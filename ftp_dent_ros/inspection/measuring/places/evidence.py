"""How surely a place departs from the skin: a matched filter over all of its footprint."""

from __future__ import annotations

import math
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.inspection.measuring.outlines.outline import Outline
from ftp_dent_ros.inspection.measuring.outlines.patch import Patch
from ftp_dent_ros.inspection.measuring.skin.lattice import Lattice
from ftp_dent_ros.inspection.measuring.skin.noise import Noise

#: Full width of a Gaussian at 10 % of its depth, in its standard deviations.
TENTH = 4.292
#: Of a Gaussian's amplitude that is fitted to noise: the same as that of a mean over so many of
# its standard deviations.
FITTED = 0.5
#: Standard deviations of bare skin whose noise is measured all over it: with 1e4 independent
# places a frame, far below one false alarm in 100.
SIGNIFICANT = 5.0
# The same of a single place that is in doubt.
SUSPECT = 3.0
# Marks that chance alone may list, per square metre.
_FALSE = 0.05
# Where the cloud's own noise is more than so many times the common one, it is what is in doubt.
_DOUBTFUL = 2.0


def by_chance(
    noise: Noise, panel: NDArray[np.bool_], lattice: Lattice, least: float = 0.0
) -> float:
    """Share of the places where the cloud is in doubt that chance alone may list.

    What is looked for at many such places is seen at one of them by chance: the more there are,
    the less often it may.

    Parameters
    ----------
    noise : Noise
    panel : ndarray, shape (rows, columns), bool
    lattice : Lattice
    least : float
        Metres: where the light is even, or noise is no depth to be listed, it is not looked for.
    """
    scale = float(noise.scales[1])
    unsure = noise.after(scale)
    doubtful = panel & (unsure > max(_DOUBTFUL * noise.where(0.0, scale), least / SIGNIFICANT))
    if least:
        doubtful &= lattice.is_uneven
    cell = lattice.spacing[0] * lattice.spacing[1]
    looks = float(doubtful.sum()) * cell / (4 * math.pi * (noise.reach**2 + scale**2))
    allowed = _FALSE * max(float(panel.sum()), 1.0) * cell
    return min(allowed / max(looks, 1.0), 0.5)


def threshold(share: float, places: float = 1.0) -> float:
    """Standard deviations of what the cloud tells of its points from which on a place is listed.

    A cloud's uncertainty beside paint is an estimate from that place alone. If its square is known
    by its order of magnitude (exponentially distributed about the truth), the errors in units of
    it follow Laplace's distribution: exp(-sqrt(2) t) of them are beyond t. On blank photographs
    of eight skins they do from 2 to 6. Where the share that chance may list is small, the ordinary
    threshold of the bare skin holds. The mean over several such places comes the nearer to a
    normal one the more they are: in between with the root of their number, which is 0.1 to 0.3
    more than differences of gamma variates, their sums, ask for.

    Parameters
    ----------
    share : float
        Of the places, that chance may list.
    places : float
        Independent ones that are asked together.
    """
    one = -math.log(share) / math.sqrt(2)
    many = NormalDist().inv_cdf(1 - share / 2)
    return min(max(many + (one - many) / math.sqrt(max(places, 1.0)), SUSPECT), SIGNIFICANT)


def chance(noise: Noise, width: float, extra: float) -> float:
    """Standard deviation of the depth of a Gaussian as wide as that, fitted to noise, metres.

    Parameters
    ----------
    noise : Noise
    width : float
        At 10 % of the depth, metres.
    extra : float
        Noise that the cloud tells of the place, metres.
    """
    return noise.where(extra, FITTED * width / TENTH)


def fitted_depth(patch: Patch, outline: Outline, length: float, width: float, angle: float):
    """Depth of the Gaussian of given sizes at 10 % that fits a patch best, metres.

    What is deep at single cells alone, as the largest of a speckle is, has none.
    """
    x, y = outline.centre
    dx, dy = patch.x - x, (patch.y - y)[:, None]
    c, s = math.cos(angle), math.sin(angle)
    u, v = TENTH * (c * dx + s * dy) / length, TENTH * (c * dy - s * dx) / width
    shape = np.where(patch.known, np.exp(-(u * u + v * v) / 2), 0.0)
    return float((patch.depth * shape).sum() / max(float((shape * shape).sum()), 1e-9))
