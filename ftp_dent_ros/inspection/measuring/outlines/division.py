"""Which dent of several that touch each cell of a patch belongs to."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.inspection.measuring.outlines.patch import Patch
from ftp_dent_ros.inspection.measuring.outlines.peak import part_above

_GREYS = 250

Mask = NDArray[np.bool_]


def divided(patch: Patch, peaks: list[tuple[int, int]], level: float) -> list[Mask | None]:
    """Regions of the peaks, parted where water would part; None of those that stand alone.

    Parameters
    ----------
    patch : Patch
    peaks : list of (int, int)
        Rows and columns.
    level : float
        Part of its depth above which a dent is connected with another, or stands alone.
    """
    if len(peaks) < 2:
        return [None] * len(peaks)
    around = [part_above(patch, peak, level * patch.depth[peak]) for peak in peaks]
    alone = [sum(bool(part[other]) for other in peaks) < 2 for part in around]
    depth = np.clip(patch.depth / max(float(patch.depth.max()), 1e-12), 0, 1)
    grey = np.rint(_GREYS * (1 - np.sqrt(depth))).astype(np.uint8)
    markers = np.zeros(depth.shape, np.int32)
    for index, (row, column) in enumerate(peaks, start=1):
        cv2.circle(markers, (column, row), 1, index, cv2.FILLED)
    found = cv2.watershed(cv2.merge([grey] * 3), markers)
    # The line between two is both's.
    line = (found == -1).astype(np.uint8)
    regions: list[Mask | None] = []
    for index in range(1, len(peaks) + 1):
        own = (found == index).astype(np.uint8)
        near = cv2.dilate(own, np.ones((3, 3), np.uint8))
        regions.append(None if alone[index - 1] else (own | (near & line)) > 0)
    return regions
