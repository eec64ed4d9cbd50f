"""Numbered surfaces: their absolute phase, smooth ones to compute it about, and their ends.

The light of a surface ends where it is better explained by that beyond than by fringes that go on.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.profilometry.fringe_model.bins import (
    ROUNDING,
    WIDTH,
    BinGrid,
    GridGeometry,
    Nearest,
    wider_than_windows,
)
from ftp_dent_ros.profilometry.fringe_model.light import Light
from ftp_dent_ros.profilometry.fringe_model.local_fit import ASIDE
from ftp_dent_ros.profilometry.fringe_model.quadric import quadric_through
from ftp_dent_ros.profilometry.fringe_model.start import DEVIATION, Start
from ftp_dent_ros.profilometry.unwrapping import wrap

# Fringes from an edge within which a window sees both sides: two of its standard deviations.
_ACROSS = 2 * WIDTH
# Loss beyond the reach of any surface, where a run ends: more than all light of a row of bins.
_NEVER = np.float32(1e9)
# What the start, smooth over a window, may differ by from the first fit, radians: two deviations.
_OFF = 2 * DEVIATION


@dataclass(frozen=True, eq=False)
class Surfaces:
    """The numbered surfaces of a photograph.

    Attributes
    ----------
    known : ndarray of bool, shape (rows, nodes)
        Where fringes are numbered.
    number : ndarray, shape (rows, nodes), int32
        Of the surface that may be there, -1 for none.
    phase, reference : ndarray, shape (rows, columns), float32
        Absolute, and that of smooth surfaces, which go on beyond their ends, radians.
    """

    known: NDArray[np.bool_]
    number: NDArray[np.int32]
    phase: NDArray[np.float32]
    reference: NDArray[np.float32]

    @classmethod
    def of(
        cls,
        geometry: GridGeometry,
        start: Start,
        orders: Sequence[int],
        numbered: NDArray[np.int32],
    ) -> Surfaces:
        """Surfaces of numbered nodes.

        What is beyond a surface is as far from its quadric as the nearest of it.

        Parameters
        ----------
        geometry : GridGeometry
        orders : sequence of int
            Whole fringes to add to each surface's phase.
        numbered : ndarray, shape (rows, nodes), int32
            Index of the order, -1 for none.
        """
        grid, bins, nodes = geometry.grid, geometry.bins, geometry.nodes
        known = numbered >= 0
        nearest = Nearest(known)
        label = nearest(numbered)
        phase = start.phase + math.tau * np.array(orders, np.float32)[label]
        inverse, _ = nodes.meet(phase)
        reference, away = np.empty(grid.shape, np.float32), np.empty_like(phase)
        for number in range(len(orders)):
            mine = (numbered == number) & np.isfinite(inverse)
            quadric = quadric_through(grid.node_places, inverse, mine)
            here = label == number
            away[here] = (phase - nodes.phase(quadric.at(*grid.node_places)))[here]
            here = grid.repeated(here)
            reference[here] = bins.phase(quadric.at(*grid.bin_places))[here]
        share = np.maximum(grid.smooth_nodes(known.astype(np.float32), 2 * WIDTH), 1e-3)
        smooth = grid.smooth_nodes(away * known, 2 * WIDTH) / share
        away = np.where(np.abs(smooth - away) < _OFF, smooth, away)
        # A surface without a number is whole fringes off its neighbour's, or none.
        beside = nearest(away)
        away = np.where(start.surface >= 0, beside + wrap(away - beside), beside)
        other = wider_than_windows((start.surface >= 0) & ~known)
        near = grid.within(known, ASIDE) & Nearest(known | other)(known)
        return cls(known, np.where(near, label, -1), reference + grid.at_bins(away), reference)

    def ends(
        self, grid: BinGrid, light: Light, start: Start
    ) -> tuple[NDArray[np.bool_], NDArray[np.float32]]:
        """Bins between the ends of the light, and the phase that goes on from inside to there."""
        inner, near = ~grid.within(~self.known, _ACROSS), grid.within(self.known, 2 * ASIDE)
        from_inside = Nearest(inner)
        away, level, amplitude = (
            grid.at_bins(from_inside(each))
            for each in (grid.at_nodes(self.phase - self.reference), start.level, start.amplitude)
        )
        onwards = self.reference + away
        beyond = grid.at_bins(Nearest(~near)(start.level))
        fringes = np.square(light.unbroken - level - amplitude * np.cos(onwards))
        gain = light.usable * (np.square(light.unbroken - beyond) - fringes)
        gain = np.where(grid.repeated(near), gain - np.float32(ROUNDING), -_NEVER)
        node, (wide, high) = grid.node, (2 * math.ceil(each / 2) + 1 for each in grid.fringe)
        total = cv2.integral(gain, sdepth=cv2.CV_64F)
        across = _stretches(total[:, ::node].T, 2 * round(wide / node / 2) + 1).T
        lit = _stretches(total, high) & grid.repeated(across)
        return lit, np.where(grid.repeated(inner), self.phase, onwards)

    def solvable(self, grid: BinGrid, lit: NDArray[np.bool_], start: Start) -> NDArray[np.bool_]:
        """Bins between the ends, with whole windows on a surface, or near another one."""
        whole = ~grid.within(~self.known, _ACROSS)
        other = wider_than_windows((start.surface >= 0) & ~self.known)
        return lit | grid.repeated(whole | grid.within(other, 2 * _ACROSS))


def _stretches(total: NDArray[np.float64], across: int) -> NDArray[np.bool_]:
    """In each run along a row the stretch whose sum is the largest: its ends are the likeliest.

    Rows are taken `across` at a time, as dark fringes tell no end.

    Parameters
    ----------
    total : ndarray, shape (rows + 1, places + 1)
        Sums over all rows above and all places before.
    """
    count = len(total) - 1
    above, below = (
        np.clip(np.arange(count) + each, 0, count) for each in (-(across // 2), across // 2 + 1)
    )
    total = total[below] - total[above]
    within = np.diff(total, axis=1) > -_NEVER / 2
    around = np.maximum.accumulate(total[:, :0:-1], axis=1)[:, ::-1]
    around = np.where(within, around - np.minimum.accumulate(total[:, :-1], axis=1), 0).ravel()
    begins = within & ~np.pad(within, ((0, 0), (1, 0)))[:, :-1]
    best = np.maximum.reduceat(around, np.append(0, np.flatnonzero(begins)))[np.cumsum(begins)]
    lit: Any = ((around == best) & (around > 0)).reshape(within.shape).view(np.uint8)
    return cv2.dilate(lit, np.ones((across, 1), np.uint8)) > 0
