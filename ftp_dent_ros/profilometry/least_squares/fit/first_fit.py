"""The first fit: fringes about a plane that only has to be roughly right.

In a Gaussian window, ``I = a + b cos Phi_0 + d sin Phi_0`` with the reference's phase Phi_0. The
normal equations are window sums; those without I depend on the rig alone, and their inverses
are kept.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.profilometry.least_squares.bins.grid import Grid
from ftp_dent_ros.profilometry.least_squares.bins.windows import Windows
from ftp_dent_ros.profilometry.least_squares.fit.polar import angle, magnitude
from ftp_dent_ros.profilometry.phase_geometry import PhaseGeometry


@dataclass(frozen=True)
class Fringes:
    """What a fit says at the nodes, all of shape (rows, columns), float32.

    Attributes
    ----------
    level, modulation : ndarray
        Mean and amplitude, grey levels.
    shift : ndarray
        Phase less that of the reference, within [-pi, pi], radians.
    """

    level: NDArray[np.float32]
    modulation: NDArray[np.float32]
    shift: NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class ReferenceTable:
    """A reference plane's fringes on a grid.

    Attributes
    ----------
    phase : ndarray
        Phi_0 at the bins and at the nodes.
    node_phase : ndarray
    cosine, sine : ndarray
        Of Phi_0 at the bins.
    inverse : ndarray, shape (3, 3, rows, columns)
        Of the normal equations, at the nodes.
    """

    phase: NDArray[np.float32]
    node_phase: NDArray[np.float32]
    cosine: NDArray[np.float32]
    sine: NDArray[np.float32]
    inverse: NDArray[np.float32]

    @classmethod
    def of(
        cls, grid: Grid, windows: Windows, bins: PhaseGeometry, nodes: PhaseGeometry, depth: float
    ) -> ReferenceTable:
        """Table of the plane z = depth."""
        phase = bins.phase(np.full(grid.bin_shape, 1 / depth, np.float32))
        node_phase = nodes.phase(np.full(grid.shape, 1 / depth, np.float32))
        cosine, sine = np.cos(phase), np.sin(phase)

        def mean(bins):
            return windows.gaussian(grid.at_nodes(bins))

        ones = mean(np.ones_like(phase))
        c, s = mean(cosine), mean(sine)
        cc, cs, ss = mean(cosine * cosine), mean(cosine * sine), mean(sine * sine)
        normal = np.array([[ones, c, s], [c, cc, cs], [s, cs, ss]], np.float32)
        inverse = np.linalg.inv(normal.transpose(2, 3, 0, 1)).transpose(2, 3, 0, 1)
        return cls(phase, node_phase, cosine, sine, np.ascontiguousarray(inverse))


def fit(grid: Grid, windows: Windows, table: ReferenceTable, bins: NDArray[np.float32]) -> Fringes:
    """Fit the fringes in each node's window.

    Parameters
    ----------
    bins : ndarray, shape (rows, columns), float32
        Grey levels of one colour.
    """
    products = np.empty((3, *bins.shape), np.float32)
    products[0] = bins
    np.multiply(bins, table.cosine, out=products[1])
    np.multiply(bins, table.sine, out=products[2])
    sums = [windows.gaussian(one) for one in grid.at_nodes(products)]
    level, cosine, sine = (
        row[0] * sums[0] + row[1] * sums[1] + row[2] * sums[2] for row in table.inverse
    )
    return Fringes(level, magnitude(cosine, sine), angle(-sine, cosine))
