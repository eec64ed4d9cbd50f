"""Fringes fitted in Gaussian windows to the bins of a mask alone.

The normal equations of ``I = a + b cos Phi + d sin Phi``, Phi a phase near the true one, are sums
over the bins that are there; where a window has too few of them, its neighbours speak for it.
Cosine and sine of coded fringes are those that their envelope makes of them.
"""

from __future__ import annotations

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
_SUMS = 8


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


class MaskedFit:
    """Fits in windows; its workspace is kept.

    Parameters
    ----------
    grid : Grid
    windows : Windows
    """

    def __init__(self, grid: Grid, windows: Windows) -> None:
        self.grid, self.windows = grid, windows
        strip, columns = grid.strips()[0].stop, grid.bin_shape[1]
        self._products = np.empty((_SUMS + 1, strip, columns), np.float32)
        self._turns = np.empty((2, strip, columns), np.float32)
        self._sums = np.empty((_SUMS + 1, *grid.shape), np.float32)

    def fit(
        self,
        levels: NDArray[np.float32],
        phase: NDArray[np.float32],
        mask: NDArray[np.bool_],
        clipped: NDArray[np.float32] | None,
        envelope: Envelope | None = None,
    ) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
        """Level, modulation and step of the phase at the nodes, continued to where none is.

        Parameters
        ----------
        levels, phase, mask : ndarray, shape (rows, bins)
            Grey levels, phase about which is fitted, radians, and the bins that count.
        clipped : ndarray, shape (rows, columns), optional
            Share of each node's window that is clipped.
        envelope : Envelope, optional
            Of coded fringes.
        """
        count = _SUMS + (envelope is not None)
        nodes = self._sums[:count]
        for rows in self.grid.strips():
            products = self._products[:count, : rows.stop - rows.start]
            weight, seen, in_phase, across, *rest = products
            cosine, sine = self._turns[:, : rows.stop - rows.start]
            np.cos(phase[rows], out=cosine)
            np.sin(phase[rows], out=sine)
            if envelope is not None:
                envelope.turn(phase[rows], cosine, sine, rows)
            np.copyto(weight, mask[rows])
            np.multiply(weight, levels[rows], out=seen)
            np.multiply(weight, cosine, out=in_phase)
            np.multiply(weight, sine, out=across)
            factors = (
                (in_phase, cosine),
                (in_phase, sine),
                (seen, cosine),
                (seen, sine),
                (across, sine),
            )
            for out, factor in zip(rest, factors, strict=False):
                np.multiply(*factor, out=out)
            nodes[:, rows] = self.grid.at_nodes(products)
        share, *sums = (self.windows.gaussian(total) for total in nodes)
        known = enough(share, clipped)
        scale = 1 / np.maximum(share, np.float32(_LEAST_SHARE if clipped is None else LEAST_SEEN))
        mean, c, s, cc, cs, p, q, *square = (total * scale for total in sums)
        # Of sines without a code, the mean square is what that of the cosines leaves.
        ss = (square[0] if square else 1 - cc) - s * s
        cs -= c * s
        cc -= c * c
        p -= mean * c
        q -= mean * s
        determinant = cc * ss - cs * cs
        least = _LEAST_VARIATION if clipped is None else _LEAST_CLIPPED
        known &= determinant > least
        inverse = 1 / np.maximum(determinant, np.float32(least))
        x = (ss * p - cs * q) * inverse
        y = (cc * q - cs * p) * inverse
        beyond = Extrapolation(known, self.windows)
        level = beyond.by_slope(mean - x * c - y * s)
        modulation = beyond.by_mean(magnitude(x, y))
        return level, modulation, beyond.by_mean(angle(-y, x))
