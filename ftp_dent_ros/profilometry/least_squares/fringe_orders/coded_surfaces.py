"""Surfaces whose fringes their contrast numbers: each by itself, wherever it lies."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.errors import NoFringesError, NoStripeError
from ftp_dent_ros.profilometry.least_squares.bins.intensity_bins import IntensityBins
from ftp_dent_ros.profilometry.least_squares.fit.first_fit import Fringes
from ftp_dent_ros.profilometry.least_squares.fit.regions import edges
from ftp_dent_ros.profilometry.least_squares.fit.surface_fit import FittedSurface, SurfaceFit
from ftp_dent_ros.profilometry.least_squares.fringe_orders.fringe_order import untied
from ftp_dent_ros.profilometry.least_squares.fringe_orders.numbering import Numbering
from ftp_dent_ros.profilometry.least_squares.fringe_orders.pieces import pieces
from ftp_dent_ros.profilometry.unwrapping import unwrap

# Between nodes one above the other, radians: a quarter of a fringe.
_JUMP = math.pi / 2
_TURN = 2 * math.pi
# Surfaces of a photograph.
_MOST = 24


class CodedSurfaces:
    """Finds the surfaces whose contrast tells their fringes' order.

    Parameters
    ----------
    fit : SurfaceFit
    """

    def __init__(self, fit: SurfaceFit) -> None:
        self._fit, self._table = fit, fit.table
        self._numbering = Numbering(fit.pattern, fit.grid, fit.period)

    def fitted(
        self,
        light: IntensityBins,
        fringes: Fringes,
        lit: NDArray[np.bool_],
        seams: NDArray[np.bool_],
    ) -> list[FittedSurface]:
        """See `Surfaces.fitted`."""
        unwrapped = unwrap(fringes.shift, lit, jump=_JUMP)
        phase = self._table.node_phase + unwrapped.phase
        waiting, expected = self._numbering.surfaces(light, phase, unwrapped.part)
        surfaces: list[FittedSurface] = []
        reason: Exception = NoStripeError(
            'no surface shows the code of the pattern: bring eight fringes side by side onto one '
            'surface, in focus, and give the pattern that is projected (pattern.yaml)'
        )
        while waiting and len(surfaces) < _MOST:
            region, order = waiting.pop(0)
            own = phase + np.float32(_TURN * order)
            try:
                surface, others = self._surface(light, lit, seams, region, own)
            except (NoFringesError, NoStripeError) as error:
                reason = error
                continue
            surfaces.append(surface)
            for piece in others:
                number = self._numbering.order(light, phase, piece, expected)
                if number is not None:
                    waiting.append((piece, number))
        if not surfaces:
            raise reason
        return surfaces

    def _surface(
        self, light, lit, seams, region, phase
    ) -> tuple[FittedSurface, list[NDArray[np.bool_]]]:
        """Fit one surface, and return the pieces that turned out to be others beside it."""
        fit = self._fit
        windows, grid, period = fit.windows, fit.grid, fit.period
        beyond = np.zeros_like(region)

        def going_on_elsewhere(region, seams, refined, _):
            lines = edges(region, seams, refined.roughness, grid, period)
            foreign = untied(region, lines, refined.shift.values, region, windows, grid, period)
            np.logical_or(beyond, foreign, out=beyond)
            return foreign

        reference = fit.reference(region, phase)
        surface = fit.surface(light, lit, seams, region, phase, reference, going_on_elsewhere)
        return surface, pieces(beyond)
