"""Places without points between places with points, and what lies over them."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
import scipy.sparse
import scipy.sparse.linalg
from numpy.typing import NDArray

# Two cells beside a gap, which an edge of light or paint may have bent.
_BESIDE = np.ones((5, 5), np.uint8)

Mask = NDArray[np.bool_]
Map = NDArray[np.floating]


def gaps_of(known: Mask, reach: int) -> Mask:
    """Cells that are not known, between known ones: holes, and strips up to `reach` cells wide."""
    if known.all():
        return np.zeros_like(known)
    radius = (reach + 1) // 2
    rim = radius + 1
    near = np.pad(known, rim)
    for _ in range(2):  # dilation by a disc, and erosion
        far = cv2.distanceTransform((~near).view(np.uint8), cv2.DIST_L2, 5)
        near = np.asarray(far) > radius
    closed = near.view(np.uint8)
    outside = 2
    cv2.floodFill(closed, None, (0, 0), outside, flags=4)
    return (closed[rim:-rim, rim:-rim] != outside) & ~known


def filled(values: Map, known: Mask, reach: int) -> tuple[Map, Map, Mask]:
    """Values, with what those around gaps suggest there; how far that is in doubt; and the gaps.

    A plate carries the slopes on into a gap, a membrane does not, and a plate through values
    farther off carries on those that nothing beside the gap has bent: how the three differ is
    the doubt.

    Parameters
    ----------
    values : ndarray, shape (rows, columns)
        Anything where not `known`.
    known : ndarray, shape (rows, columns), bool
    reach : int
        Cells between known ones that a strip is filled across.
    """
    gaps, doubt = gaps_of(known, reach), np.zeros_like(values)
    if not gaps.any():
        return values, doubt, gaps
    window = tuple(
        slice(max(at[0] - len(_BESIDE), 0), at[-1] + len(_BESIDE) + 1)
        for at in (np.flatnonzero(gaps.any(axis=axis)) for axis in (1, 0))
    )
    # A plate depends on two cells about it, and two more may be left out.
    part, free = gaps[window], ~known[window]
    given = np.where(free, 0, values[window]).astype(float)
    farther = cv2.dilate(free.view(np.uint8), _BESIDE) > 0
    stiff, slack = (_solved(given, free, each(free.shape)) for each in (_bending, _laplacian))
    wide = stiff if farther.all() else _solved(given, farther, _bending(free.shape))
    values = values.copy()
    values[window][part] = stiff[part]
    doubt[window][part] = np.hypot(stiff - wide, stiff - slack)[part]
    return values, doubt, gaps


def _solved(values: Map, over: Mask, equations: scipy.sparse.csr_matrix) -> Map:
    """Values that solve the equations of the cells `over` from those of the others."""
    free = np.flatnonzero(over)
    given = np.where(over, 0.0, values)
    rows = equations[free]
    found = given.copy()
    found[over] = scipy.sparse.linalg.spsolve(rows[:, free].tocsc(), -(rows @ given.ravel()))
    return found


# One gap is filled in several ways, and the equations of its window are made once.
@lru_cache(maxsize=1)
def _bending(shape: tuple[int, ...]) -> scipy.sparse.csr_matrix:
    bent = _laplacian(shape)
    return bent.T @ bent


@lru_cache(maxsize=1)
def _laplacian(shape: tuple[int, ...]) -> scipy.sparse.csr_matrix:
    """Five-point Laplacian of a grid whose border reflects."""

    def line(count: int) -> scipy.sparse.csr_matrix:
        ends = np.full(count, -2.0)
        ends[[0, -1]] = -1
        return scipy.sparse.diags([np.ones(count - 1), ends, np.ones(count - 1)], [-1, 0, 1])

    rows, columns = shape
    return scipy.sparse.kronsum(line(columns), line(rows), format='csr')
