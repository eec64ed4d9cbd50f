"""Which dent of several that touch each cell of a patch belongs to."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.inspection.measuring.outlines.moments import Moments
from ftp_dent_ros.inspection.measuring.outlines.patch import Patch
from ftp_dent_ros.inspection.measuring.outlines.peak import part_above

_GREYS = 250
# Levels between which the parts of one dent are compared, as parts of its depth.
LEVELS = 0.25, 0.5, 0.75, 0.85
# How much of the width centres may move over so many of them in one dent, and axis ratios change
# over all; and what the noise, as a part of the depth, adds to that: chosen on synthetic dents of
# eight shapes, of which a fiftieth is flagged, and on pairs of them.
_COMPARED, _MOVED, _CHANGED = 3, 0.06, 0.13
_MOVED_NOISE, _CHANGED_NOISE = 3.0, 6.0
# Cells that have a form, and across what is looked at: a coarser patch is sampled three times as
# finely, for the edges of its cells are no form.
_FEWEST, _ACROSS, _FINER = 30, 42, 3

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


def parts_of(patch: Patch, at: tuple[int, int], depth: float, width: float) -> list[Mask]:
    """What lies above each of `LEVELS` around the deepest cell of a dent, in a window about it.

    Parameters
    ----------
    patch : Patch
    at : (int, int)
        Row and column.
    depth, width : float
        Of the dent, metres.
    """
    if width < _ACROSS * patch.step:
        rows, columns = patch.depth.shape
        size = _FINER * columns, _FINER * rows
        fine = cv2.resize(patch.depth, size, interpolation=cv2.INTER_CUBIC)
        known = cv2.resize(patch.known.view(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0
        # The middle of a cell is that of its middle part.
        at = _FINER * at[0] + _FINER // 2, _FINER * at[1] + _FINER // 2
        patch = replace(patch, step=patch.step / _FINER, depth=np.asarray(fine), known=known)
    widest = part_above(patch, at, LEVELS[0] * depth)
    # All that is deeper lies within it.
    left, top, across, down = cv2.boundingRect(widest.view(np.uint8))
    window = slice(top, top + down), slice(left, left + across)
    patch = replace(patch, depth=patch.depth[window], known=widest[window])
    at = at[0] - top, at[1] - left
    return [
        widest[window],
        *(part_above(patch, at, level * depth) for level in LEVELS[1:]),
    ]


def looks_compound(parts: list[Mask], noise: float) -> bool:
    """Whether the parts above rising levels differ in place or form, as of two dents in one.

    Parameters
    ----------
    parts : list of ndarray of bool
        What lies above each of `LEVELS`.
    noise : float
        As a part of the depth.
    """
    shapes = []
    for part in parts:
        moments = Moments.of(part)
        if moments.cells < _FEWEST:
            break
        along, across = moments.ellipse()
        shapes.append((moments.column, moments.row, across, along / across))
    if len(shapes) < _COMPARED:
        return False
    x, y, width, ratio = zip(*shapes, strict=True)
    moved = math.hypot(_range(x[:_COMPARED]), _range(y[:_COMPARED])) / width[0]
    changed = _range(ratio) * len(ratio) / sum(ratio)
    return moved > _MOVED + _MOVED_NOISE * noise or changed > _CHANGED + _CHANGED_NOISE * noise


def _range(values: Sequence[float]) -> float:
    return max(values) - min(values)
