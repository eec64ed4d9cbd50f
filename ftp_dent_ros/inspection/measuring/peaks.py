"""The dents of one place: its maxima, and which cells are each one's."""

from __future__ import annotations

import cv2
import numpy as np

from ftp_dent_ros.inspection.measuring.lattice import LEVEL
from ftp_dent_ros.inspection.measuring.noise import SURE
from ftp_dent_ros.inspection.measuring.outline import part_above
from ftp_dent_ros.inspection.measuring.patch import Mask, Patch
from ftp_dent_ros.inspection.measuring.segmentation import nearest

_LEVELS = 32


def peaks_of(patch: Patch, least: float) -> list[tuple[int, int]]:
    """Rows and columns of the maxima that stand out from their saddles, the deepest first.

    Parameters
    ----------
    patch : Patch
    least : float
        Depth that a maximum has at least, metres.
    """
    values = np.where(patch.known, patch.depth, 0.0).astype(np.float32)
    unsure = np.hypot(patch.strays, patch.doubt)
    top = cv2.dilate(values, np.ones((5, 5), np.uint8))
    at = np.argwhere((values == top) & patch.own & (values > least))
    order = np.argsort(-values[tuple(at.T)], kind='stable')
    at, heights = at[order], values[tuple(at[order].T)]
    if len(at) < 2:
        return [(int(row), int(column)) for row, column in at]
    saddles = np.zeros((len(at), len(at)))
    step = float(heights[0]) / _LEVELS
    for level in step * np.arange(_LEVELS):
        _, labels = cv2.connectedComponents((values > level).view(np.uint8))
        place = labels[tuple(at.T)]
        saddles[(place[:, None] == place) & (place > 0)] = level
    kept = [0]
    for index in range(1, len(at)):
        fall = heights[index] - saddles[index, kept].max() - step
        if fall > max(LEVEL * heights[index], SURE * unsure[tuple(at[index])]):
            kept.append(index)
    return [(int(row), int(column)) for row, column in at[kept]]


def divided(
    patch: Patch, peaks: list[tuple[int, int]], level: float
) -> list[tuple[Mask | None, bool]]:
    """Cells of each peak, divided where water would divide, and whether it overlaps another one.

    Parameters
    ----------
    patch : Patch
    peaks : list of (int, int)
        Rows and columns.
    level : float
        Part of its depth above which a dent is connected with one that it overlaps.
    """
    if len(peaks) < 2:
        return [(None, False) for _ in peaks]
    found = np.full(patch.depth.shape, -1, np.int32)
    found[tuple(np.array(peaks).T)] = np.arange(len(peaks))
    for depth in np.linspace(float(patch.depth.max()), 0.0, _LEVELS):
        reached = patch.known & (patch.depth >= depth) & (found < 0)
        found = np.where(reached, nearest(found), found)
    around = [part_above(patch, peak, level * patch.depth[peak], None) for peak in peaks]
    return [
        (found == index, sum(bool(part[other]) for other in peaks) > 1)
        for index, part in enumerate(around)
    ]
