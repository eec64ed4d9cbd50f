"""Strips of one panel that hang on the edge of another, beyond a gap in their own."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.dents.dent import SmallestDent
from ftp_dent_ros.inspection.measuring.skin.continuation import depths_of
from ftp_dent_ros.inspection.measuring.skin.lattice import Lattice
from ftp_dent_ros.inspection.measuring.skin.panels import Panel
from ftp_dent_ros.robust import median

# Part of a strip's deviation from the panel that it hangs on that is left from its own.
_LEFT = 0.33

Mask = NDArray[np.bool_]


def given_back(
    lattice: Lattice, panels: list[Panel], labels: NDArray[np.int32], settings: SmallestDent
) -> tuple[list[Panel], NDArray[np.int32], Mask]:
    """Give each strip to the panel beyond the gap, whose contour explains it.

    Between a lap's edge and the row of rivets behind it, a strip may be parted from its own panel
    by what is not measured, while the blurred edge joins it to the other.

    Returns
    -------
    panels : list of Panel
    labels : ndarray, shape (rows, columns), int32
    strips : ndarray, shape (rows, columns), bool
        Cells that were given back: edge and gap blur all of them.
    """
    strips = np.zeros(labels.shape, bool)
    if len(panels) < 2:
        return panels, labels, strips
    labels = labels.copy()
    size = 2 * math.ceil(settings.smallest_width / max(lattice.spacing)) + 1
    reach = [cv2.dilate(each.mask.astype(np.uint8), np.ones((size, size))) > 0 for each in panels]
    for index, panel in enumerate(panels):
        own = np.abs(depths_of(panel.contour, lattice, panel.mask))
        off = (panel.mask & (own > panel.tolerance)).astype(np.uint8)
        _, parts = cv2.connectedComponents(off, connectivity=4)
        for other, beyond in enumerate(panels):
            if other == index:
                continue
            for number in np.unique(parts[reach[other] & (off > 0)]):
                part = parts == number
                theirs = np.abs(beyond.contour.deviation(lattice.points[part])[2])
                if median(theirs) < _LEFT * median(own[part]):
                    labels[part] = other
                    strips |= part
    panels = [replace(each, mask=labels == number) for number, each in enumerate(panels)]
    return panels, labels, strips
