"""Fringes fitted in Gaussian windows to the bins of a mask alone.

The normal equations of ``I = a + b cos Phi + d sin Phi``, Phi a phase near the true one, are sums
over the bins that are there; where a window has too few of them, its neighbours speak for it.
Cosine and sine of coded fringes are those that their envelope makes of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.profilometry.least_squares.bins.extrapolation import Extrapolation
from ftp_dent_ros.profilometry.least_squares.bins.grid import Grid
from ftp_dent_ros.profilometry.least_squares.bins.windows import Windows
from ftp_dent_ros.profilometry.least_squares.code.contrast_model import Envelope
from ftp_dent_ros.profilometry.least_squares.fit.polar import angle, magnitude

# Share of a window that must be on the surface for a fit of its own, and of what is left of a
# fringe's variation then.
_LEAST_SHARE, _LEAST_VARIATION = 0.7, 0.05
# Share of a window that must be seen all the same for a point, and its variation, where crests
# are clipped: what is left of them are flanks.
LEAST_SEEN, _LEAST_CLIPPED = 0.25, 0.005
# Products of cosine and sine, of coded fringes.
_SQUARES = 3


def enough(share: NDArray[np.float32], clipped: NDArray[np.float32] | None) -> NDArray[np.bool_]:
    """Nodes of which enough is seen for a fit: clipped crests leave enough of their window.

    Parameters
    ----------
    share, clipped : ndarray, shape (rows, columns), float32
        Shares of each node's window that are seen, and that are clipped; None if none are.
    """
    if clipped is None:
        return share > _LEAST_SHARE
    return (share + clipped > _LEAST_SHARE) & (share > LEAST_SEEN)


@dataclass(frozen=True, eq=False)
class Equations:
    """Normal equations of the fringes of one phase in one mask, for levels of any brightness.

    Attributes
    ----------
    weighted : ndarray, shape (3, rows, bins), float32
        The mask, and cosine and sine in it.
    scale : ndarray, shape (rows, columns), float32
        Makes means of sums in the windows; `means` are those of cosine and sine.
    inverse : ndarray, shape (3, rows, columns), float32
        Of the equations for their amplitudes: first, mixed and last element.
    told : ndarray, shape (rows, columns), bool
        Nodes that have a fit of their own.
    beyond : Extrapolation
        From these.
    """

    grid: Grid
    windows: Windows
    weighted: NDArray[np.float32]
    scale: NDArray[np.float32]
    means: tuple[NDArray[np.float32], NDArray[np.float32]]
    inverse: NDArray[np.float32]
    told: NDArray[np.bool_]
    beyond: Extrapolation

    def solved(
        self, levels: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
        """Level, modulation and step of the phase at the nodes, continued to where none is.

        Parameters
        ----------
        levels : ndarray, shape (rows, bins), float32
            Grey levels, or multiples of them.
        """
        c, s = self.means
        nodes = np.empty((len(self.weighted), *self.grid.shape), np.float32)
        for rows in self.grid.strips():
            nodes[:, rows] = self.grid.at_nodes(self.weighted[:, rows] * levels[rows])
        mean, p, q = (self.windows.gaussian(total) * self.scale for total in nodes)
        p -= mean * c
        q -= mean * s
        first, mixed, last = self.inverse
        x = first * p + mixed * q
        y = mixed * p + last * q
        level = self.beyond.by_slope(mean - x * c - y * s)
        return level, self.beyond.by_mean(magnitude(x, y)), self.beyond.by_mean(angle(-y, x))


class MaskedFit:
    """Fits in windows; its workspace is kept, so that each fit's equations end those before.

    Parameters
    ----------
    grid : Grid
    windows : Windows
    """

    def __init__(self, grid: Grid, windows: Windows) -> None:
        self.grid, self.windows = grid, windows
        strip, columns = grid.strips()[0].stop, grid.bin_shape[1]
        self._products = np.empty((_SQUARES, strip, columns), np.float32)
        self._weighted = np.empty((3, *grid.bin_shape), np.float32)
        self._sums = np.empty((3 + _SQUARES, *grid.shape), np.float32)

    def equations(
        self,
        phase: NDArray[np.float32],
        mask: NDArray[np.bool_],
        clipped: NDArray[np.float32] | None,
        envelope: Envelope | None = None,
    ) -> Equations:
        """Equations of the fringes in a mask.

        Parameters
        ----------
        phase, mask : ndarray, shape (rows, bins)
            Phase about which is fitted, radians, and the bins that count.
        clipped : ndarray, shape (rows, columns), optional
            Share of each node's window that is clipped.
        envelope : Envelope, optional
            Of coded fringes.
        """
        squares = _SQUARES - (envelope is None)
        nodes = self._sums[: 3 + squares]
        for rows in self.grid.strips():
            weighted, products = self._weighted[:, rows], self._products[:squares]
            products = products[:, : rows.stop - rows.start]
            weight, cosine, sine = weighted
            np.cos(phase[rows], out=cosine)
            np.sin(phase[rows], out=sine)
            if envelope is not None:
                envelope.turn(phase[rows], cosine, sine, rows)
            np.copyto(weight, mask[rows])
            cosine *= weight
            sine *= weight
            factors = (cosine, cosine), (cosine, sine), (sine, sine)
            for out, factor in zip(products, factors, strict=False):
                np.multiply(*factor, out=out)
            nodes[:3, rows] = self.grid.at_nodes(weighted)
            nodes[3:, rows] = self.grid.at_nodes(products)
        share, *sums = (self.windows.gaussian(total) for total in nodes)
        known = enough(share, clipped)
        scale = 1 / np.maximum(share, np.float32(_LEAST_SHARE if clipped is None else LEAST_SEEN))
        c, s, cc, cs, *square = (total * scale for total in sums)
        # Of sines without a code, the mean square is what that of the cosines leaves.
        ss = (square[0] if square else 1 - cc) - s * s
        cs -= c * s
        cc -= c * c
        determinant = cc * ss - cs * cs
        least = _LEAST_VARIATION if clipped is None else _LEAST_CLIPPED
        known &= determinant > least
        inverse = np.stack([ss, -cs, cc]) / np.maximum(determinant, np.float32(least))
        beyond, means = Extrapolation(known, self.windows), (c, s)
        return Equations(
            self.grid, self.windows, self._weighted, scale, means, inverse, known, beyond
        )
