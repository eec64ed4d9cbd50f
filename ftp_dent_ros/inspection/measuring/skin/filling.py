"""Maps filled where they are not known."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import scipy.sparse
import scipy.sparse.linalg
from numpy.typing import NDArray

# Cells: two that a plate depends on, two that may be left out, and one more.
_NEAR = 5

Mask = NDArray[np.bool_]
Map = NDArray[np.float64]


def membrane(values: Map, over: Mask) -> Map:
    """Values, those of the cells `over` such that each is the mean of its four neighbours."""
    return _solved(values, over, _laplacian(over.shape))


def plate(values: Map, over: Mask) -> Map:
    """Values, those of the cells `over` such that the surface bends least: slopes go on."""
    return _solved(values, over, _bending(over.shape))


def around(over: Mask) -> tuple[slice, slice]:
    """The part of a map that a fill depends on: the cells about all that is filled."""
    rows, columns = (np.flatnonzero(over.any(axis=axis)) for axis in (1, 0))
    return (
        slice(max(rows[0] - _NEAR, 0), rows[-1] + _NEAR + 1),
        slice(max(columns[0] - _NEAR, 0), columns[-1] + _NEAR + 1),
    )


def _solved(values: Map, over: Mask, equations: scipy.sparse.csr_matrix) -> Map:
    """Values that solve the equations of the cells `over` from those of the others."""
    free = np.flatnonzero(over)
    given = np.where(over, 0.0, values).ravel()
    rows = equations[free]
    found = np.where(over, 0.0, values)
    found[over] = scipy.sparse.linalg.spsolve(rows[:, free].tocsc(), -(rows @ given))
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
