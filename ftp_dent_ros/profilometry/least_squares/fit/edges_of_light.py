"""Edges that the skin's light leaps at, of paint or shadow, and the two sides of each.

Of lines and letters, narrower than a window, no side can be told by itself: they are none here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.profilometry.least_squares.bins.grid import Grid
from ftp_dent_ros.profilometry.least_squares.bins.windows import blurred

# Fringes and rows of bins over which a bin's brightness is seen: fringes are dark between; and
# the share of these that must be seen.
_NARROW, _LEAST_SHARE = (0.25, 0.7), 0.5
# Brightness over the smoothed one's on both sides of an edge, less 1, at least.
_LEAP = 0.1
# Fringes and rows of bins between places that show so, and beside an edge where a window that
# sees it may reach.
_ACROSS, _BESIDE = (0.7, 2), (1.3, 3)
# Share of the leap beyond which a bin tells its side by itself; the others go with what does so
# around, within these fringes and rows.
_SURE, _VOTE = 0.35, (0.5, 1.0)
_LEAST_VOTE = 0.01
# Fringes and rows over which an edge is followed, and the share of it that must be one.
_ALONG, _MOST = (2.0, 6.0), 0.75
# Fringes on either side of an edge over which the first fit's phase is not trusted, and of the
# widest gap that is bridged.
_BRIDGE, _LONGEST = 1.2, 6.0
_LEAST = 1e-3  # share: no division by zero


@dataclass(frozen=True, eq=False)
class EdgesOfLight:
    """Bins beside edges.

    Attributes
    ----------
    lighter, darker, crossed : ndarray, shape (rows, bins), bool
        Bins on either side, and those that an edge crosses.
    near : ndarray, shape (rows, bins), bool
        Bins about as near to an edge as its place is uncertain by.
    """

    lighter: NDArray[np.bool_]
    darker: NDArray[np.bool_]
    crossed: NDArray[np.bool_]
    near: NDArray[np.bool_]

    @property
    def sides(self) -> NDArray[np.bool_]:
        """Bins on either side."""
        return self.lighter | self.darker

    @classmethod
    def of(
        cls,
        levels: NDArray[np.float32],
        smooth: NDArray[np.float32],
        seen: NDArray[np.bool_],
        clipped: NDArray[np.bool_],
        period: float,
    ) -> EdgesOfLight | None:
        """Edges in the light; None if there are none.

        Of a highlight, whose rim is none, the light on one side is not known: there are none.

        Parameters
        ----------
        levels, smooth : ndarray, shape (rows, bins), float32
            Grey levels, and those of the same fringes on a skin whose brightness is smooth.
        seen, clipped : ndarray, shape (rows, bins), bool
            Bins that tell, and those of too much light.
        period : float
            Of the fringes, bins.
        """
        bright = _brightness(levels, smooth, seen, period)
        across = _kernel(_ACROSS, period)
        window = _kernel(_BESIDE, period)
        near = grown(bright > _LEAP, across) & grown(bright < -_LEAP, across)
        if clipped.any():
            near &= ~grown(clipped, window)
        if not near.any():
            return None
        beside = grown(near, window)
        size = np.abs(bright)
        leap = cv2.dilate(cv2.dilate(size, window), across)
        sure = size > np.float32(_SURE) * leap
        vote = _blurred(np.where(sure & beside, np.sign(bright), np.float32(0)), _VOTE, period)
        vote[np.abs(vote) < _LEAST_VOTE] = 0
        bright = np.where(sure | near, bright, vote)
        crossed = near & _crossed(bright)
        lighter, darker = (beside & ~crossed & side for side in (bright > 0, bright < 0))
        return cls(lighter, darker, crossed, near)

    def within(self, kept: NDArray[np.bool_], period: float) -> EdgesOfLight:
        """Those of some of the crossed bins alone."""
        across = _kernel(_ACROSS, period)
        near = self.near & grown(kept, across)
        beside = grown(grown(kept, across), _kernel(_BESIDE, period))
        return EdgesOfLight(self.lighter & beside, self.darker & beside, kept, near)


def told(agree: NDArray[np.bool_], sides: NDArray[np.bool_], period: float) -> NDArray[np.float32]:
    """Share of the bins on the sides of edges, around each bin, that agree with their side."""
    around = _BESIDE[0] / 2, _BESIDE[1] / 2
    whole = _blurred(sides.astype(np.float32), around, period)
    part = _blurred((agree & sides).astype(np.float32), around, period)
    return part / np.maximum(whole, np.float32(_LEAST))


def mostly(
    some: NDArray[np.bool_], crossed: NDArray[np.bool_], period: float
) -> NDArray[np.bool_]:
    """Some of the crossed bins, where they are most of those around."""
    whole, part = (_blurred(each.astype(np.float32), _ALONG, period) for each in (crossed, some))
    return some & (part > np.float32(_MOST) * whole)


def bridged(
    nodes: NDArray[np.float32], crossed: NDArray[np.bool_], grid: Grid, period: float
) -> NDArray[np.float32]:
    """A field across edges, straight along u from where windows do not see them.

    Parameters
    ----------
    nodes : ndarray, shape (rows, columns), float32
    crossed : ndarray, shape (rows, bins), bool
    grid : Grid
    period : float
        Of the fringes, bins.
    """
    at_nodes = crossed.reshape(len(crossed), -1, grid.bins).any(axis=2)
    gap = grown(at_nodes, _kernel((_BRIDGE, 1), period / grid.bins))
    # What is wider, or reaches the image's rim, stays.
    longest = 2 * math.ceil(_LONGEST / 2 * period / grid.bins) + 1
    padded = np.pad(gap, ((0, 0), (longest, longest)), constant_values=True)
    wide: Any = cv2.morphologyEx(padded.view(np.uint8), cv2.MORPH_OPEN, np.ones((1, longest)))
    gap &= wide[:, longest:-longest] == 0
    ends = grown(gap, np.ones((1, 3), np.uint8)) & ~gap
    result = nodes.copy()
    unknown, known = np.flatnonzero(gap), np.flatnonzero(ends)
    if len(known):
        result.flat[unknown] = np.interp(unknown, known, nodes.flat[known])
    return result


def grown(mask: Any, kernel: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """A mask and what is around it."""
    wider: Any = cv2.dilate(mask.view(np.uint8), kernel)
    return wider > 0


def _brightness(levels, smooth, seen, period) -> NDArray[np.float32]:
    """Of the skin at the bins over the smoothed one, less 1: least squares over a few bins."""
    share = _blurred(seen.astype(np.float32), _NARROW, period)
    weight = smooth * seen
    both = _blurred(weight * levels, _NARROW, period)
    square = _blurred(weight * smooth, _NARROW, period)
    bright: NDArray[np.float32] = both / np.maximum(square, np.float32(1)) - np.float32(1)
    bright[share <= _LEAST_SHARE] = 0
    return bright


def _crossed(bright) -> NDArray[np.bool_]:
    """Bins whose brightness changes its sign within them or from one beside."""
    # An edge aslant crosses what lies between the middles of rows, half of which is a bin's.
    halves = (bright[1:] + bright[:-1]) / 2
    highest, lowest = bright.copy(), bright.copy()
    for part in (slice(1, None), slice(None, -1)):
        np.maximum(highest[part], halves, out=highest[part])
        np.minimum(lowest[part], halves, out=lowest[part])
    beside = np.ones((1, 3), np.uint8)
    return grown(highest > 0, beside) & grown(lowest <= 0, beside)


def _blurred(field, reach: tuple[float, float], period: float) -> NDArray[np.float32]:
    return blurred(field, (reach[0] * period, reach[1]), cv2.BORDER_REPLICATE)


def _kernel(reach: tuple[float, int], period: float) -> NDArray[np.uint8]:
    return np.ones((2 * reach[1] + 1, 2 * math.ceil(reach[0] * period) + 1), np.uint8)
