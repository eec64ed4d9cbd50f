"""The points around a candidate on a patch as fine as its size and its noise allow."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.inspection.measuring.outlines.patch import Patch
from ftp_dent_ros.inspection.measuring.places.detection import Candidate
from ftp_dent_ros.inspection.measuring.places.evidence import SIGNIFICANT
from ftp_dent_ros.inspection.measuring.places.surroundings import Surroundings
from ftp_dent_ros.inspection.measuring.skin.noise import Noise

# Cells of the patch along a dent, and across one at least.
_CELLS = 64
_ACROSS = 14
# Of the smoothing: part of the dent's width at least, at most, and at most where it would drown in
# the noise; and the part of its depth that noise may be.
_SMALLEST, _WIDEST, _DROWNED = 0.02, 0.04, 0.15
_CLEAN = 0.01

Mask = NDArray[np.bool_]


def patch_of(candidate: Candidate, around: Surroundings, noise: Noise) -> Patch:
    """Depths around a candidate, smoothed as its noise demands and its size allows."""
    size = min(2 * math.sqrt(candidate.area / math.pi), candidate.width)
    x_min, x_max, y_min, y_max = around.bounds
    spread = max(x_max - x_min, y_max - y_min)
    step = max(around.spacing, min(spread / (2 * _CELLS), size / _ACROSS))
    scale = max(_SMALLEST * size, 0.7 * step)
    while (local := noise.where(around.extra, scale)) > _CLEAN * candidate.height:
        drowned = SIGNIFICANT * local > candidate.height
        if scale > (_DROWNED if drowned else _WIDEST) * size:
            break
        scale *= 1.3
    depth = candidate.sign * around.depth
    return Patch.of(around.x, around.y, depth, around.stated, around.bounds, step, scale)


def own_cells(patch: Patch, around: Surroundings) -> Mask:
    """Cells of a patch that are the candidate's, not another one's beside it."""
    column, row = (
        np.rint(each).astype(int) for each in patch.cells(around.cells[0], around.cells[1])
    )
    rows, columns = patch.depth.shape
    own = np.zeros((rows, columns), np.uint8)
    inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
    own[row[inside], column[inside]] = 1
    size = 2 * math.ceil(0.75 * around.cell / patch.step) + 1
    return cv2.dilate(own, np.ones((size, size), np.uint8)) > 0
