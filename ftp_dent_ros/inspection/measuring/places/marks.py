"""A change of the light within an outline: where paint or material is gone."""

from __future__ import annotations

import cv2
import numpy as np

from ftp_dent_ros.inspection.measuring.outlines.outline import Outline
from ftp_dent_ros.inspection.measuring.outlines.patch import Patch
from ftp_dent_ros.inspection.measuring.places.surroundings import Surroundings
from ftp_dent_ros.robust import NORMAL_SPREAD, median

# Cells around an outline that it is held against.
_AROUND = 7
# Points that a median is taken of, at least.
_FEWEST = 5


def mark_in(around: Surroundings, patch: Patch, outline: Outline) -> tuple[float, float]:
    """How the light in an outline differs from that beside it, and how far the latter varies.

    Both as parts of the latter.
    """
    cells = patch.cells(around.x, around.y)
    column, row = (np.rint(each).astype(int) for each in cells)
    rows, columns = patch.depth.shape
    held = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
    at, light = (row[held], column[held]), around.light[held]
    inside = outline.inside > 0.5
    wide = cv2.dilate(inside.astype(np.uint8), np.ones((_AROUND, _AROUND), np.uint8)) > 0
    within, without = light[inside[at]], light[(wide & (outline.inside == 0))[at]]
    if min(len(within), len(without)) < _FEWEST:
        return 0.0, 0.0
    usual = median(without)
    if not usual > 0:
        return 0.0, 0.0
    varies = NORMAL_SPREAD * median(np.abs(without - usual))
    return (median(within) - usual) / usual, varies / usual
