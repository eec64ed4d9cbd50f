"""Fringes across an edge of paint or shadow, with level and amplitude of each of its sides.

Where light leaps within a window, no level and amplitude are those of both sides, and what they
leave passes for a phase. So both are fitted to each side alone and carried on to the edge; light
is evened by those of its own side, and bins that the edge crosses are left out.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.profilometry.least_squares.bins.grid import Grid
from ftp_dent_ros.profilometry.least_squares.bins.limits import at_least
from ftp_dent_ros.profilometry.least_squares.bins.windows import Windows
from ftp_dent_ros.profilometry.least_squares.code.contrast_model import Envelope
from ftp_dent_ros.profilometry.least_squares.fit.edges_of_light import (
    EdgesOfLight,
    bridged,
    mostly,
    told,
)
from ftp_dent_ros.profilometry.least_squares.fit.masked_fit import MaskedFit

# Windows over which the level is smoothed that tells lighter from darker, and the contrast that
# light of both sides is given.
_WIDE, _SMOOTH = 2.0, 2.0
# A bin goes with its side if it is off by no more than this share of its level and of the leap,
# and of its level at most.
_OFF, _OF_LEAP, _MOST_OFF = 0.03, 0.1, 0.15
# Share of the bins around that must go with their sides for two sides to be all there is.
_LEAST_TOLD = 0.85
# Fits from what is bridged on.
_FITS = 2

# From a shift, the phase at the bins, and its cosine and sine as the fringes have them.
Fringes = Callable[[NDArray[np.float32]], tuple[NDArray[np.float32], ...]]


@dataclass(frozen=True, eq=False)
class OneLight:
    """Fringes as a fit of one level and amplitude has them.

    Attributes
    ----------
    levels, even : ndarray, shape (rows, bins), float32
        Grey levels, and these over the brightness.
    level, modulation, bright : ndarray, shape (rows, columns), float32
        Of the fringes at the nodes, grey levels, and their brightness.
    shift : ndarray, shape (rows, columns), float32
        Phase less the reference's.
    cosine : ndarray, shape (rows, bins), float32
        Of that phase, as the fringes have it.
    mask, surface, clipped : ndarray, shape (rows, bins), bool
        Bins that the fringes explain, those of the surface, and those that are clipped.
    """

    levels: NDArray[np.float32]
    even: NDArray[np.float32]
    level: NDArray[np.float32]
    modulation: NDArray[np.float32]
    bright: NDArray[np.float32]
    shift: NDArray[np.float32]
    cosine: NDArray[np.float32]
    mask: NDArray[np.bool_]
    surface: NDArray[np.bool_]
    clipped: NDArray[np.bool_]

    @property
    def seen(self) -> NDArray[np.bool_]:
        """Bins of the surface that are not clipped."""
        return self.surface & ~self.clipped


@dataclass(frozen=True, eq=False)
class TwoSided:
    """Fringes of light of which no edges are left.

    Attributes
    ----------
    shift, level, modulation : ndarray, shape (rows, columns), float32
        Phase less the reference's at the nodes, and level and amplitude of this light.
    variance : ndarray, shape (rows, columns), float32
        Of the phase by what is not known of the sides, as the last fit's step shows it, radians^2.
    even : ndarray, shape (rows, bins), float32
    mask, crossed, beside : ndarray, shape (rows, bins), bool
        Bins that count, those without a light of their own, and all that are beside edges.
    known : ndarray, shape (rows, columns), float32, optional
        Share of each node's window that is in a half shadow whose light is known.
    amplitude : ndarray, shape (rows, columns), float32, optional
        Of the fringes as they are, grey levels, where that is told.
    """

    shift: NDArray[np.float32]
    level: NDArray[np.float32]
    modulation: NDArray[np.float32]
    variance: NDArray[np.float32]
    even: NDArray[np.float32]
    mask: NDArray[np.bool_]
    crossed: NDArray[np.bool_]
    beside: NDArray[np.bool_]
    known: NDArray[np.float32] | None = None
    amplitude: NDArray[np.float32] | None = None


class TwoSidedFit:
    """Fits fringes to light that is evened on both sides of edges.

    Parameters
    ----------
    grid : Grid
    windows : Windows
    masked : MaskedFit
    period : float
        Of the fringes, bins.
    """

    def __init__(self, grid: Grid, windows: Windows, masked: MaskedFit, period: float) -> None:
        self.grid, self.windows, self.period = grid, windows, period
        self._masked = masked

    def fitted(
        self,
        one: OneLight,
        edges: EdgesOfLight,
        fringes_of: Fringes,
        envelope: Envelope | None,
    ) -> TwoSided | None:
        """Fringes of light evened by the sides of its edges; None if it has none.

        Parameters
        ----------
        one : OneLight
        edges : EdgesOfLight
            Of this light.
        fringes_of : callable
        envelope : Envelope, optional
            Of coded fringes.
        """
        # Beside an edge the phase is off, and with it the place where the edge is seen.
        phase, cosine, _ = fringes_of(self._bridged(one, edges.crossed))
        again = self.edges(one, cosine)
        if again is None:
            return None
        edges = again
        agree, _ = self._by_sides(one, edges, phase, cosine, envelope)
        whole = told(agree | ~one.seen, edges.sides, self.period) > _LEAST_TOLD
        kept = mostly(edges.crossed & whole, edges.crossed, self.period)
        if not kept.any():
            return None
        edges = edges.within(kept, self.period)
        used = (one.mask | edges.sides) & one.seen
        shift = self._bridged(one, kept)
        for _ in range(_FITS):
            phase, cosine, _ = fringes_of(shift)
            agree, even = self._by_sides(one, edges, phase, cosine, envelope)
            crossed = kept | (edges.near & edges.sides & ~agree)
            mask, lost = used & ~crossed, self._masked.share_of(crossed | one.clipped)
            equations = self._masked.equations(phase, mask, lost, envelope)
            level, modulation, step = equations.solved(even)
            shift = shift + step
        beside = edges.sides | kept
        # Away from the edges everything stays as it was.
        share = self._masked.share_of(beside)
        shift = one.shift + share * (shift - one.shift)
        variance = share * self.windows.gaussian(np.square(step))
        return TwoSided(shift, level, modulation, variance, even, mask, crossed, beside)

    def _by_sides(
        self, one: OneLight, edges: EdgesOfLight, phase, cosine, envelope
    ) -> tuple[NDArray[np.bool_], NDArray[np.float32]]:
        """Bins that go with their side, and light evened by the sides."""
        (usual, target), sides = self.even_light(one), (edges.lighter, edges.darker)
        lights = [self.light(one, side, phase, envelope) for side in sides]
        off = [np.abs(one.levels - level - size * cosine) for level, size in lights]
        leap = np.abs(lights[0][0] - lights[1][0])
        agree, even = np.zeros_like(one.mask), one.even.copy()
        for side, (level, size), mine, other in zip(sides, lights, off, off[::-1], strict=True):
            most = np.minimum(_OFF * level + _OF_LEAP * leap, _MOST_OFF * level)
            here = side & (mine < other) & (mine < most) & (size > 1)
            gain = target / at_least(size, 1)
            np.copyto(even, (one.levels - level) * gain + usual, where=here)
            agree |= here
        return agree, even

    def even_light(self, one: OneLight) -> tuple[Any, Any]:
        """Level and amplitude at the bins that light is given where it is evened."""
        even_level = one.level / one.bright
        contrast = one.modulation / at_least(one.level, 1)
        amplitude = self.windows.wide(contrast, _SMOOTH) * even_level
        return self.grid.at_bins(even_level), self.grid.at_bins(amplitude)

    def light(
        self,
        one: OneLight,
        side: NDArray[np.bool_],
        phase: NDArray[np.float32],
        envelope: Envelope | None,
    ) -> tuple[Any, Any]:
        """Level and amplitude of one side at the bins, carried on beyond it."""
        equations = self._masked.equations(phase, one.seen & side, None, envelope)
        level, modulation, _ = equations.solved(one.levels)
        return self.grid.at_bins(level), self.grid.at_bins(modulation)

    def edges(self, one: OneLight, cosine: NDArray[np.float32]) -> EdgesOfLight | None:
        """Edges in a light whose fringes have this cosine, shape (rows, bins); None if none."""
        contrast = one.modulation / at_least(one.level, 1)
        model = 1 + self.grid.at_bins(contrast) * cosine
        light = self.grid.at_bins(self.windows.wide(one.level, _WIDE))
        return EdgesOfLight.of(one.levels, model * light, one.seen, one.clipped, self.period)

    def _bridged(self, one: OneLight, crossed) -> NDArray[np.float32]:
        return bridged(one.shift, crossed, self.grid, self.period)
