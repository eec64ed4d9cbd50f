"""Places of a patch that are deeper than all around them, by more than the noise."""

from __future__ import annotations

import cv2
import numpy as np

from ftp_dent_ros.inspection.measuring.outlines.patch import Patch

# The saddle to a deeper maximum lies lower by so many standard deviations of the noise.
_SIGNIFICANT = 6.0
# And by this part of the height.
DROP = 0.12
_LEVELS = 32
_MOST = 40
_KERNEL = np.ones((5, 5), np.uint8)


def maxima_of(
    patch: Patch, noise: float, least: float, drop: float = DROP
) -> list[tuple[int, int]]:
    """Rows and columns of the maxima that stand out from their saddles, the deepest first.

    Parameters
    ----------
    patch : Patch
    noise : float
        Standard deviation of its depths, metres.
    least : float
        Depth that a maximum has at least, metres.
    drop : float
        How far the saddle to a deeper one lies below a maximum, as a part of its height.
    """
    values = np.where(patch.known, patch.depth, 0.0).astype(np.float32)
    top = cv2.dilate(values, _KERNEL)
    at = np.argwhere((values == top) & (values > max(least, _SIGNIFICANT * noise)))
    heights = values[at[:, 0], at[:, 1]]
    order = np.argsort(-heights, kind='stable')[:_MOST]
    at, heights = at[order], heights[order]
    kept = [0] if len(at) else []
    if len(at) > 1:
        saddles, step = _saddles(values, at, float(heights[0]))
        for index in range(1, len(at)):
            fall = heights[index] - saddles[index, kept].max() - step
            if fall > max(drop * heights[index], _SIGNIFICANT * noise):
                kept.append(index)
    return [(int(row), int(column)) for row, column in at[kept]]


def _saddles(values, at, highest: float):
    """Highest of some levels at which two places are connected, and the levels' step."""
    saddles = np.zeros((len(at), len(at)))
    levels = np.linspace(0, 1, _LEVELS, endpoint=False) * highest
    for level in levels:
        _, labels = cv2.connectedComponents((values > level).astype(np.uint8))
        place = labels[at[:, 0], at[:, 1]]
        saddles[(place[:, None] == place[None]) & (place[:, None] > 0)] = level
    return saddles, levels[1]
