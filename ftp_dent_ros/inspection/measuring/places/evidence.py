"""How surely a place departs from the skin: a matched filter over all of its footprint."""

from __future__ import annotations

import math

import numpy as np

from ftp_dent_ros.inspection.measuring.outlines.outline import Outline
from ftp_dent_ros.inspection.measuring.outlines.patch import Patch
from ftp_dent_ros.inspection.measuring.skin.noise import Noise

#: Full width of a Gaussian at 10 % of its depth, in its standard deviations.
TENTH = 4.292
#: Of a Gaussian's amplitude that is fitted to noise: the same as that of a mean over so many of
# its standard deviations.
FITTED = 0.5
#: Standard deviations of the noise from which on a place is listed: of 12 000 independent ones a
# square metre (noise over a fringe, at three scales) chance lists 0.05 (normally distributed).
SIGNIFICANT = 4.6


def chance(noise: Noise, width: float, extra: float) -> float:
    """Standard deviation of the depth of a Gaussian as wide as that, fitted to noise, metres.

    Parameters
    ----------
    noise : Noise
    width : float
        At 10 % of the depth, metres.
    extra : float
        Noise that the cloud states of the place, metres.
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
