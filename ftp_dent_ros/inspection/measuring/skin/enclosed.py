"""Parts of one panel within another: a dent's bottom, or a window to what lies behind."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.inspection.measuring.skin.continuation import depths_of
from ftp_dent_ros.inspection.measuring.skin.contour import Contour
from ftp_dent_ros.inspection.measuring.skin.lattice import Lattice
from ftp_dent_ros.inspection.measuring.skin.second_panel import at_frame, core_of, is_stepped


def with_enclosed(
    lattice: Lattice, contours: list[Contour], labels: NDArray[np.int32], least: float
) -> NDArray[np.int32]:
    """Labels of panels, with the bottoms of dents given to the panel around them.

    A dent in the upper sheet of a lap may be as deep as the lower sheet lies, and its bottom
    agree with that sheet's contour. It is too small for a panel, or rises slowly to what is
    around it; a window to the lower sheet is stepped.

    Parameters
    ----------
    lattice : Lattice
    contours : list of Contour
        Of the panels.
    labels : ndarray, shape (rows, columns), int32
        Index of each cell's panel; -1 where there is none.
    least : float
        Cells of the smallest panel.
    """
    if len(contours) < 2:
        return labels
    given = labels.copy()
    kernel = np.ones((3, 3), np.uint8)
    for index in range(len(contours)):
        _, parts, stats, _ = cv2.connectedComponentsWithStats(
            (labels == index).astype(np.uint8), connectivity=4
        )
        areas = stats[1:, cv2.CC_STAT_AREA]
        for number in np.argsort(-areas, kind='stable')[1:] + 1:
            part = parts == number
            ring = (cv2.dilate(part.astype(np.uint8), kernel) > 0) & ~part
            around = np.unique(labels[ring & (labels >= 0)])
            if len(around) != 1 or at_frame(part):
                continue
            if areas[number - 1] >= least:
                whole = part | (labels == around[0])
                deviation = depths_of(contours[around[0]], lattice, whole)
                if is_stepped(deviation, part, core_of(part), whole):
                    continue
            given[part] = around[0]
    return given
