"""One surface's fit: about the quadric through what the first fit made of it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.errors import NoStripeError
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.profilometry.least_squares.bins.exposure import check_fringes
from ftp_dent_ros.profilometry.least_squares.bins.extrapolation import Extrapolation
from ftp_dent_ros.profilometry.least_squares.bins.grid import Grid
from ftp_dent_ros.profilometry.least_squares.bins.intensity_bins import IntensityBins
from ftp_dent_ros.profilometry.least_squares.bins.windows import Windows, sighted
from ftp_dent_ros.profilometry.least_squares.code.contrast_model import ContrastModel
from ftp_dent_ros.profilometry.least_squares.fit.coded_start import CodedStart
from ftp_dent_ros.profilometry.least_squares.fit.first_fit import ReferenceTable
from ftp_dent_ros.profilometry.least_squares.fit.quadric import evaluate, robust_quadric
from ftp_dent_ros.profilometry.least_squares.fit.refined import Refined
from ftp_dent_ros.profilometry.least_squares.fit.refinement import Refinement
from ftp_dent_ros.profilometry.least_squares.fit.regions import apart, eroded, rim_strips
from ftp_dent_ros.profilometry.phase_geometry import PhaseGeometry
from ftp_dent_ros.robust import median

# The nodes of a region that are not its surface's, by the seams in it, its fit and its phase.
Others = Callable[
    [NDArray[np.bool_], NDArray[np.bool_], Refined, NDArray[np.float32]], NDArray[np.bool_]
]

_TURN = 2 * math.pi
# Fits of a surface, each without what the last one found not to be a part of it.
_FITS = 3
# Fringes' periods go in steps, so that one table of windows serves many surfaces.
_PERIOD_STEP, _LONGEST = 1.08, 1.6
# Such steps by which windows are narrower where a surface is no skin: to 0.4 fringes, chosen on
# photographs of one relief.
_FINER = 3
# Standard deviation of a usual lens's blur, pixels of projector or camera.
_LENS = 0.6
# Of a pixel's even width, pixels^2.
_PIXEL = 1 / 12
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
    """

    def __init__(
        self,
        pattern: Pattern,
        period: float,
        grid: Grid,
        windows: Windows,
        nodes: PhaseGeometry,
        table: ReferenceTable,
    ) -> None:
        self.pattern, self.period, self.grid, self.windows = pattern, period, grid, windows
        self.nodes, self.table = nodes, table
        self._code = ContrastModel(pattern) if pattern.code == 'contrast' else None
        self._refinement = lru_cache(maxsize=4)(self._refinement_at)
        self._start = lru_cache(maxsize=4)(self._start_at)

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
        sure = region if relief else sighted(region, self.windows)
        shift = Extrapolation(sure, self.windows).by_slope((phase - reference) * region)
        if refinement.windows.sigma_u > self.windows.sigma_u:
            # Narrow windows have let ripples through, which wide ones do not see.
            shift = refinement.windows.flat_top(shift)
        table, whole = self.table, region | strips
        start, seen, envelope, unsure = reference - table.node_phase, None, None, None
        usual = self._expected_blur(reference)
        if self._code is not None:
            base = table.phase + self.grid.at_bins(start)
            decoded = self._start(step - _FINER * relief).decoded(light, base, shift, whole, usual)
            shift, envelope, unsure = decoded.shift, decoded.envelope, decoded.variance
            seen = decoded.blur
        refined = refinement.refine(
            *(light, table.phase, start, shift, whole, usual, seen, envelope, relief)
        )
        if unsure is not None:
            refined.shift.variance[:] += unsure
        check_fringes(refined.roughness[region])
        return refined

    def surface(
        self,
        light: IntensityBins,
        lit: NDArray[np.bool_],
        seams: NDArray[np.bool_],
        region: NDArray[np.bool_],
        phase: NDArray[np.float32],
        reference: NDArray[np.float32],
        others: Others,
    ) -> FittedSurface:
        """Fit one surface; again without what turns out to be another's.

        Parameters
        ----------
        light : IntensityBins
        lit, seams : ndarray, shape (rows, columns), bool
            Nodes that see fringes of one surface, and those in between that see two.
        region : ndarray, shape (rows, columns), bool
            Nodes of the surface, as far as is known.
        phase, reference : ndarray, shape (rows, columns), float32
            Absolute phase of the first fit, and that of the quadric through it.
        others : callable
            From a region, the seams in it, its fit and its absolute phase: the nodes of it that
            are another surface's.

        Raises
        ------
        NoFringesError, NoStripeError
        """
        step = self.period_step(reference, region)
        strips = rim_strips(region, lit, seams)
        foreign, seams = lit & ~region & ~strips, seams & ~strips
        relief = False
        for _ in range(_FITS):
            region = apart(region, foreign, seams, self.grid, self.period)
            refined = self.refined(light, region, strips, phase, reference, step, relief)
            absolute = reference + refined.shift.values
            if relief:
                break
            if refined.relief:
                # What is no skin has edges everywhere: it is one surface as far as its phase is.
                relief, foreign = True, np.zeros_like(region)
                step = self.period_step(reference, region)
                continue
            foreign = others(region, seams, refined, absolute)
            if not foreign.any():
                break
            reference = self.reference(region & ~foreign, phase)
        return FittedSurface(refined, absolute, region)

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

    def _expected_blur(self, reference) -> NDArray[np.float32]:
        """Variance of the blur of usual lenses and of the bins, at the nodes, radians^2."""
        slope = np.gradient(reference, axis=1) / np.float32(self.grid.pitch[0])
        of_projector = (_TURN * _LENS / self.pattern.period_px) ** 2
        of_camera = self.grid.bin_variance + _PIXEL + _LENS**2
        return np.square(slope) * np.float32(of_camera) + np.float32(of_projector)

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
        return Refinement(self.grid, windows, period, self.pattern.rounding_shifts)

    def _start_at(self, step: int) -> CodedStart:
        period = self.period * _PERIOD_STEP**step
        assert self._code is not None
        return CodedStart(self._code, self.grid, Windows.for_fringes(period, self.grid), period)
