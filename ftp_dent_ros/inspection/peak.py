"""The deepest place of a dent, and how wide it is there."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.inspection.patch import Patch

# Of the cap that the depth is read from.
_CAP = 0.6
# Part of what lies around a dent that is not measured, from which on it is cut.
_OPEN = 0.05

Vector = NDArray[np.float64]
Field = NDArray[np.float64]


def highest(patch: Patch, peak: Vector) -> tuple[int, int] | None:
    """Row and column of the maximum uphill of a place."""
    column, row = (round(float(v)) for v in patch.cells(peak[0], peak[1]))
    rows, columns = patch.depth.shape
    for _ in range(rows + columns):
        top, left = max(row - 3, 0), max(column - 3, 0)
        window = patch.depth[top : row + 4, left : column + 4]
        if not window.size or window.max() <= 0:
            return None
        i, j = np.unravel_index(np.argmax(window), window.shape)
        if (top + i, left + j) == (row, column):
            break
        row, column = int(top + i), int(left + j)
    return row, column


def extent(patch: Patch, at: tuple[int, int], share: float) -> tuple[float, float, bool]:
    """Length and width of what is deeper than a share of a cell's depth around it, metres.

    Those of the ellipse with the same second moments, and whether it leaves what is measured.
    """
    deep = (patch.depth > share * patch.depth[at]) & patch.known
    _, labels = cv2.connectedComponents(deep.astype(np.uint8), connectivity=4)
    part = (labels == labels[at]).astype(np.uint8)
    rows, columns = np.nonzero(part)
    if not labels[at] or len(rows) < 2:
        return patch.step, patch.step, False
    moments = np.cov(np.stack([columns, rows]).astype(float)) + np.eye(2) / 12
    across, along = 4 * patch.step * np.sqrt(np.linalg.eigvalsh(moments))
    around = cv2.dilate(part, np.ones((3, 3), np.uint8)) > part
    return float(along), float(across), bool((~patch.known[around]).mean() > _OPEN)


def deepest_of(patch: Patch, at: tuple[int, int], model: Field) -> float:
    """Maximum of the model and a quadratic of what it leaves on the cap around a cell."""
    every = patch.depth.shape
    rows, columns = np.mgrid[: every[0], : every[1]]
    high = patch.depth[at]
    cap = patch.known & (patch.depth > _CAP * high)
    distance = np.hypot(rows - at[0], columns - at[1])
    # Not into a neighbour: as far as the cap's area would reach as a long ellipse.
    cap &= distance < 2.5 * math.sqrt(max(cap.sum(), 1) / math.pi)
    if cap.sum() < 40:
        return float(high)
    reach = float(distance[cap].max())
    u, v = (columns[cap] - at[1]) / reach, (rows[cap] - at[0]) / reach
    degree = 2 if model.any() else 4
    powers = [(i - j, j) for i in range(degree + 1) for j in range(i + 1)]
    basis = np.stack([u**i * v**j for i, j in powers], axis=1)
    solution = np.linalg.lstsq(basis, (patch.depth - model)[cap], rcond=None)[0]
    top = basis @ solution + model[cap]
    if degree == 2:
        # Where the model is deepest: a maximum over noise would be too deep.
        return float(top[np.argmax(model[cap])])
    middle = top[np.hypot(u, v) < 0.6]
    return float(middle.max()) if len(middle) else float(high)
