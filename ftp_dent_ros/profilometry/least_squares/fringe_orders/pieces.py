"""Masks of nodes in pieces: what hangs together, and what one surface can go on through."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.profilometry.least_squares.fit.regions import SMALLEST
from ftp_dent_ros.robust import median

# Phase from one row of nodes to the next, less the usual, that no surface has: quarter a fringe.
_JUMP = np.pi / 2


def touching(mask: NDArray[np.bool_], others: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """What of a mask hangs together with others, by its sides.

    Parameters
    ----------
    mask, others : ndarray, shape (rows, columns), bool
    """
    labels: Any
    count, labels = cv2.connectedComponents((mask | others).view(np.uint8), connectivity=4)
    touching = np.zeros(count, bool)
    touching[labels[others]] = True
    touching[0] = False
    return mask & touching[labels]


def continuous(region: NDArray[np.bool_], phase: NDArray[np.float32]) -> list[NDArray[np.bool_]]:
    """A region cut where its phase leaps from one row to the next, and at necks of a node or two.

    What lies beyond may be numbered rightly all the same, but no one surface goes through both.

    Parameters
    ----------
    region : ndarray, shape (rows, columns), bool
        Nodes.
    phase : ndarray, shape (rows, columns), float32
        Of the fringes at the nodes, radians.
    """
    both = region[1:] & region[:-1]
    if not both.any():
        return [region]
    step = np.diff(phase, axis=0)
    leap = both & (np.abs(step - median(step[both])) > _JUMP)
    cut = region.copy()
    cut[1:] &= ~leap
    cut[:-1] &= ~leap
    cores = pieces(cv2.erode(cut.view(np.uint8), np.ones((3, 3)), borderValue=1) > 0)
    if len(cores) < 2:
        return [region]
    found = []
    for core in cores:
        # A node is what erosion took, and one more is the rim's.
        grown = cut & (cv2.dilate(core.view(np.uint8), np.ones((5, 5))) > 0)
        cut &= ~grown
        found.append(grown)
    return found


def pieces(mask: NDArray[np.bool_]) -> list[NDArray[np.bool_]]:
    """Connected pieces of a mask of nodes that are large enough for a surface, of its shape."""
    labels: Any
    count, labels = cv2.connectedComponents(mask.view(np.uint8), connectivity=4)
    sizes = np.bincount(labels.ravel(), minlength=count)
    return [labels == label for label in range(1, count) if sizes[label] >= SMALLEST]
