"""Surfaces whose fringes the red stripe numbers: it lies on them, or their phase goes on."""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.errors import NoFringesError, NoStripeError
from ftp_dent_ros.profilometry.least_squares.bins.intensity_bins import IntensityBins
from ftp_dent_ros.profilometry.least_squares.fit.first_fit import Fringes
from ftp_dent_ros.profilometry.least_squares.fit.regions import edges, eroded, separated
from ftp_dent_ros.profilometry.least_squares.fit.surface_fit import FittedSurface, SurfaceFit
from ftp_dent_ros.profilometry.least_squares.fit.surface_mask import roughness
from ftp_dent_ros.profilometry.least_squares.fringe_orders.frame_rim import FrameRim
from ftp_dent_ros.profilometry.least_squares.fringe_orders.fringe_order import (
    joined,
    off_frame,
    untied,
)
from ftp_dent_ros.profilometry.stripe import stripe_orders
from ftp_dent_ros.profilometry.unwrapping import Unwrapped, unwrap

# Rows of bins in which the stripe is looked for.
_STRIPE_ROWS = 15
# Between nodes one above the other, radians: a quarter of a fringe.
_JUMP = math.pi / 2
_TURN = 2 * math.pi


class StripeSurfaces:
    """Finds the surfaces that the stripe ties.

    Parameters
    ----------
    fit : SurfaceFit
    """

    def __init__(self, fit: SurfaceFit) -> None:
        self._fit, self._table, self.grid = fit, fit.table, fit.grid
        self._place = fit.windows, fit.grid, fit.period

    def fitted(
        self,
        light: IntensityBins,
        fringes: Fringes,
        lit: NDArray[np.bool_],
        seams: NDArray[np.bool_],
    ) -> list[FittedSurface]:
        """See `Surfaces.fitted`."""
        phase, part, orders = self._absolute(light, fringes, lit, seams)
        foreign = np.arange(1, part.max() + 3)
        foreign[list(orders)], foreign[-1] = 0, 0
        others = foreign[part]
        surfaces: list[FittedSurface] = []
        refusals: list[NoFringesError | NoStripeError] = []
        for label, order in orders.items():
            own = phase - np.float32(_TURN * order)
            try:
                surfaces.append(self._surface(light, lit, seams, part == label, others, own))
            except (NoFringesError, NoStripeError) as reason:
                refusals.append(reason)
        if not surfaces:
            raise refusals[-1]
        return surfaces

    def _absolute(self, light, fringes, lit, seams):
        """Phase at the nodes, the part each is tied to, and the stripe's order by part."""
        table, (windows, _, period) = self._table, self._place
        unwrapped = unwrap(fringes.shift, lit, jump=_JUMP)
        try:
            orders = self._orders(light, unwrapped)
        except NoStripeError:
            # Two surfaces may have been taken for one: cut along edges, and vote again.
            phase = table.phase + self.grid.at_bins(unwrapped.phase)
            model = self.grid.at_bins(fringes.level)
            amplitude = self.grid.at_bins(fringes.modulation)
            misfit = (light.red - model - amplitude * np.cos(phase)) / np.maximum(amplitude, 1)
            rough = roughness(misfit, windows, self.grid)
            cut = separated(lit, edges(lit, seams, rough, self.grid, period))
            unwrapped = unwrap(fringes.shift, cut, jump=_JUMP)
            orders = self._orders(light, unwrapped)
        return table.node_phase + unwrapped.phase, unwrapped.part, orders

    def _orders(self, light: IntensityBins, unwrapped: Unwrapped) -> dict[int, int]:
        """Fringe order at the stripe of each part that holds it."""
        rows = np.unique(np.linspace(0, self.grid.shape[0] - 1, _STRIPE_ROWS).astype(int))
        size = self.grid.bin_shape[1], len(rows)
        shift = cv2.resize(unwrapped.phase[rows], size, interpolation=cv2.INTER_LINEAR)
        part: Any = self.grid.to_bins(unwrapped.part[rows])
        # Where it is interpolated across parts, the shift means nothing.
        part[:, 1:-1][(part[:, 1:-1] != part[:, 2:]) | (part[:, 1:-1] != part[:, :-2])] = -1
        return stripe_orders(
            self._table.phase[rows] + shift, part, light.red[rows], light.others(rows)
        )

    def _surface(self, light, lit, seams, region, others, phase) -> FittedSurface:
        """Fit one surface with all that goes on from it, and without what does not."""
        fit, place = self._fit, self._place
        _, grid, period = place
        reference = fit.reference(region, phase)
        turns = joined(eroded(region), others * eroded(others > 0), phase - reference, *place)
        for label, number in turns.items():
            more = others == label
            region = region | more
            phase = phase + np.float32(_TURN * number) * more
        if turns:
            reference = fit.reference(region, phase)

        def not_tied(region, seams, refined, absolute):
            at_stripe, rough = np.abs(absolute) < math.pi, refined.roughness
            lines = edges(region, seams, rough, grid, period)
            foreign = untied(region, lines, refined.shift.values, at_stripe, *place)
            rim = FrameRim.of(refined.measured, absolute, fit.pattern, grid)
            if rim.off(rim.blocks()):
                lines = edges(region, seams, rough, grid, period, faint=True)
                foreign = foreign | off_frame(region, lines, at_stripe, rim)
            if foreign.any():
                self._check_stripe(light, phase, region & ~foreign)
                foreign = cv2.dilate(foreign.view(np.uint8), np.ones((9, 9), np.uint8)) > 0
            return foreign

        return fit.surface(light, lit, seams, region, phase, reference, not_tied)

    def _check_stripe(self, light, phase, region) -> None:
        """Raise if what is left of a region does not hold the stripe, or another order's."""
        shift = phase - self._table.node_phase
        left = Unwrapped(shift, np.where(region, 0, -1).astype(np.int32))
        if self._orders(light, left)[0] != 0:
            raise NoStripeError(
                'the red stripe lies on the edge between two surfaces: move it onto one of them'
            )
