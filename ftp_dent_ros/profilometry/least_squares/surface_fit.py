"""One surface's fit: about the quadric through what the first fit made of it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.errors import NoStripeError
from ftp_dent_ros.pattern import Pattern
from ftp_dent_ros.profilometry.least_squares.contrast_model import ContrastModel, Envelope
from ftp_dent_ros.profilometry.least_squares.exposure import check_fringes
from ftp_dent_ros.profilometry.least_squares.extrapolation import Extrapolation
from ftp_dent_ros.profilometry.least_squares.first_fit import ReferenceTable, fit
from ftp_dent_ros.profilometry.least_squares.grid import Grid
from ftp_dent_ros.profilometry.least_squares.intensity_bins import IntensityBins
from ftp_dent_ros.profilometry.least_squares.median import median
from ftp_dent_ros.profilometry.least_squares.phase_geometry import PhaseGeometry
from ftp_dent_ros.profilometry.least_squares.quadric import evaluate, robust_quadric
from ftp_dent_ros.profilometry.least_squares.refinement import Refined, Refinement
from ftp_dent_ros.profilometry.least_squares.regions import eroded, sighted
from ftp_dent_ros.profilometry.least_squares.windows import Windows
from ftp_dent_ros.profilometry.unwrapping import wrap

_TURN = 2 * math.pi
# Fringes' periods go in steps, so that one table of windows serves many surfaces.
_PERIOD_STEP, _LONGEST = 1.08, 1.6
# Such steps by which windows are narrower where a surface is no skin: to 0.4 fringes, chosen on
# photographs of one relief.
_FINER = 3
# Standard deviation of a usual lens's blur, pixels of projector or camera.
_LENS = 0.6
# Fits by which the code is taken off the first one: each leaves a quarter of what it finds.
_DECODINGS = 2
# Nodes that the quadric is fitted to, about.
_POINTS = 600


@dataclass(frozen=True, eq=False)
class FittedSurface:
    """A surface whose fringes are numbered.

    Attributes
    ----------
    refined : Refined
    phase : ndarray, shape (rows, columns), float32
        Absolute, radians.
    region : ndarray, shape (rows, columns), bool
        Nodes of the surface.
    """

    refined: Refined
    phase: NDArray[np.float32]
    region: NDArray[np.bool_]


class SurfaceFit:
    """Fits surfaces of one rig and pattern.

    Parameters
    ----------
    pattern : Pattern
    period : float
        Of the fringes on the reference plane, pixels.
    grid : Grid
    windows : Windows
    nodes : PhaseGeometry
    table : ReferenceTable
    fast : bool
    """

    def __init__(
        self,
        pattern: Pattern,
        period: float,
        grid: Grid,
        windows: Windows,
        nodes: PhaseGeometry,
        table: ReferenceTable,
        fast: bool,
    ) -> None:
        self.pattern, self.period, self.grid, self.windows = pattern, period, grid, windows
        self.nodes, self.table, self._fast = nodes, table, fast
        self._contrast = ContrastModel(pattern) if pattern.code == 'contrast' else None
        self._refinement = lru_cache(maxsize=4)(self._refinement_at)

    def refined(
        self,
        light: IntensityBins,
        region: NDArray[np.bool_],
        strips: NDArray[np.bool_],
        phase: NDArray[np.float32],
        reference: NDArray[np.float32],
        step: int,
        relief: bool = False,
    ) -> Refined:
        """Fit about a smooth reference.

        Parameters
        ----------
        light : IntensityBins
        region, strips : ndarray, shape (rows, columns), bool
            Nodes of the surface, and strips along its rim that the first fit did not see.
        phase, reference : ndarray, shape (rows, columns), float32
            Absolute phase of the first fit, and of the reference.
        step : int
            Of `period_step`.
        relief : bool
            Whether the surface is no skin, and narrow windows are wanted.

        Raises
        ------
        NoFringesError
        """
        refinement = self._refinement(step - _FINER * relief)
        envelope = None
        if self._contrast is not None:
            phase, envelope = self._decoded(light, region, phase, reference)
        sure = region if relief else sighted(region, self.windows)
        shift = Extrapolation(sure, self.windows).by_slope((phase - reference) * region)
        if refinement.windows.sigma_u > self.windows.sigma_u:
            # Narrow windows have let ripples through, which wide ones do not see.
            shift = refinement.windows.flat_top(shift)
        table = self.table
        start = reference - table.node_phase
        refined = refinement.refine(light, table.phase, start, shift, region | strips, envelope)
        check_fringes(refined.roughness[region])
        return refined

    def reference(self, region, phase) -> NDArray[np.float32]:
        """Phase at the nodes of the quadric through a region's first fit.

        Raises
        ------
        NoStripeError
            The phase is none that the projector can light.
        """
        inner = eroded(region)
        chosen = inner if inner.sum() > 0.2 * region.sum() else region
        flat = np.flatnonzero(chosen)
        row, column = np.divmod(flat[:: max(1, len(flat) // _POINTS)], chosen.shape[1])
        points = self.nodes.at(row, column)
        inverse_depth, _ = points.meet(phase[row, column][None])
        met = np.isfinite(inverse_depth)
        if met.sum() < 6:
            striped = self.pattern.code == 'stripe'
            seen = 'the red stripe is seen' if striped else 'the code tells fringes'
            raise NoStripeError(
                f'{seen} where the projector cannot light it: check that rig.yaml '
                'and the pattern belong to this camera and projector'
            )
        quadric = robust_quadric(points.rays[met], inverse_depth[met])
        return self.nodes.phase(evaluate(quadric, self.nodes.rays))

    def _decoded(self, light, region, phase, reference) -> tuple[NDArray[np.float32], Envelope]:
        """Phase of the first fit without what the code did to it, and the code's envelope."""
        table, grid, contrast = self.table, self.grid, self._contrast
        assert contrast is not None
        slope = np.gradient(reference, axis=1) / grid.pitch[0]
        of_camera = np.square(slope) * np.float32(grid.bin_variance + _LENS**2)
        of_projector = (_TURN * _LENS / self.pattern.period_px) ** 2
        variance = grid.to_bins(of_camera + np.float32(of_projector))
        inside = grid.to_bins(region) & ~light.clipped
        beyond = Extrapolation(region, self.windows)
        envelope = contrast.envelope(variance)
        amplitude = inside * grid.at_bins(fit(grid, self.windows, table, light.grey).modulation)
        for _ in range(_DECODINGS):
            # The first fit again, of the light less what the code does to it.
            at_bins = self._at_bins(beyond, phase, reference)
            cosine, sine = np.cos(at_bins), np.sin(at_bins)
            code = -cosine
            envelope.turn(at_bins, cosine, sine, slice(None))
            code += cosine
            fringes = fit(grid, self.windows, table, light.grey - amplitude * code)
            phase = phase + wrap(table.node_phase + fringes.shift - phase)
        at_bins = self._at_bins(beyond, phase, reference)
        more = np.float32(contrast.blur(light.grey, at_bins, inside, variance))
        return phase, contrast.envelope(variance + more)

    def _at_bins(self, beyond, phase, reference) -> NDArray[np.float32]:
        """Phase at the bins, continued beyond the region."""
        shift = beyond.by_slope(phase - reference)
        return self.table.phase + self.grid.at_bins(reference - self.table.node_phase + shift)

    def period_step(self, phase, region) -> int:
        """Power of `_PERIOD_STEP` by which a surface's fringes are longer than the table's."""
        both = region[::2, 1:] & region[::2, :-1]
        slope = median(np.abs(np.diff(phase[::2], axis=1)[both])) if both.any() else 0
        period = _TURN * self.grid.pitch[0] / max(slope, 1e-3)
        most = math.log(_LONGEST) / math.log(_PERIOD_STEP)
        step = math.log(period / self.period) / math.log(_PERIOD_STEP)
        return round(min(max(step, -most), most))

    def _refinement_at(self, step: int) -> Refinement:
        period = self.period * _PERIOD_STEP**step
        windows = Windows.for_fringes(period, self.grid)
        return Refinement(self.grid, windows, period, self._fast, self.pattern.rounding_variance)
