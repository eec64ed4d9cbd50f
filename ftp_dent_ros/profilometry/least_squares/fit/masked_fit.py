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
from ftp_dent_ros.profilometry.least_squares.bins.limits import at_least
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
        mean, x, y = self._found(levels)
        c, s = self.means
        level = self.beyond.by_slope(mean - x * c - y * s)
        return level, self.beyond.by_mean(magnitude(x, y)), self.beyond.by_mean(angle(-y, x))

    def step(self, levels: NDArray[np.float32]) -> NDArray[np.float32]:
        """The step of the phase alone, as `solved` has it."""
        _, x, y = self._found(levels)
        return self.beyond.by_mean(angle(-y, x))

    def _found(self, levels) -> tuple[NDArray[np.float32], ...]:
        """Mean of levels, and amplitudes of cosine and sine, at the nodes."""
        c, s = self.means
        nodes = self.grid.at_nodes(self.weighted * levels)
        mean, p, q = (self.windows.gaussian(total) * self.scale for total in nodes)
        p -= mean * c
        q -= mean * s
        first, mixed, last = self.inverse
        return mean, first * p + mixed * q, mixed * p + last * q


class MaskedFit:
    """Fits in windows; its workspace is kept, so that each fit's equations end those before.

    Parameters
    ----------
    grid : Grid
    windows : Windows
    """

    def __init__(self, grid: Grid, windows: Windows) -> None:
        self.grid, self.windows = grid, windows
        self._terms = np.empty((3 + _SQUARES, *grid.bin_shape), np.float32)

    def share_of(self, mask: NDArray[np.bool_]) -> NDArray[np.float32]:
        """Share of each node's window that a mask of the bins has."""
        return self.windows.gaussian(self.grid.at_nodes(mask.astype(np.float32)))

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
        terms = self._terms[: 3 + _SQUARES - (envelope is None)]
        weight, cosine, sine, *squares = terms
        np.cos(phase, out=cosine)
        np.sin(phase, out=sine)
        if envelope is not None:
            envelope.turn(phase, cosine, sine)
        np.copyto(weight, mask)
        cosine *= weight
        sine *= weight
        factors = (cosine, cosine), (cosine, sine), (sine, sine)
        for out, factor in zip(squares, factors, strict=False):
            np.multiply(*factor, out=out)
        share, *sums = (self.windows.gaussian(total) for total in self.grid.at_nodes(terms))
        known = enough(share, clipped)
        scale = 1 / at_least(share, _LEAST_SHARE if clipped is None else LEAST_SEEN)
        c, s, cc, cs, *square = (total * scale for total in sums)
        # Of sines without a code, the mean square is what that of the cosines leaves.
        ss = (square[0] if square else 1 - cc) - s * s
        cs -= c * s
        cc -= c * c
        determinant = cc * ss - cs * cs
        least = _LEAST_VARIATION if clipped is None else _LEAST_CLIPPED
        known &= determinant > least
        inverse = np.stack([ss, -cs, cc]) / at_least(determinant, least)
        beyond, means = Extrapolation(known, self.windows), (c, s)
        return Equations(
            self.grid, self.windows, self._terms[:3], scale, means, inverse, known, beyond
        )


def fringes_at(
    phase: NDArray[np.float32], envelope: Envelope | None
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Cosine and sine of a phase, radians, as a code's envelope makes them."""
    cosine, sine = np.cos(phase), np.sin(phase)
    if envelope is not None:
        envelope.turn(phase, cosine, sine)
    return cosine, sine
