"""Windowed least squares about the analytic reference: the default method, one line a step."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.cloud.coverage import Coverage
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.photograph.photograph import Photograph
from ftp_dent_ros.profilometry.carrier import ReferencePlane, carrier_on
from ftp_dent_ros.profilometry.epipolar_check import EpipolarCheck, check_epipolar
from ftp_dent_ros.profilometry.least_squares.bins.exposure import check_exposure
from ftp_dent_ros.profilometry.least_squares.bins.grid import Grid
from ftp_dent_ros.profilometry.least_squares.bins.intensity_bins import IntensityBins
from ftp_dent_ros.profilometry.least_squares.bins.windows import WIDTH, Windows
from ftp_dent_ros.profilometry.least_squares.cloud_builder import (
    CloudBuilder,
    Published,
    near,
    parted,
)
from ftp_dent_ros.profilometry.least_squares.code.camera_curve import light_power
from ftp_dent_ros.profilometry.least_squares.fit.colours import in_register
from ftp_dent_ros.profilometry.least_squares.fit.first_fit import ReferenceTable, fit
from ftp_dent_ros.profilometry.least_squares.fit.regions import eroded, fringe_region, surfaces_in
from ftp_dent_ros.profilometry.least_squares.fit.surface_fit import FittedSurface, SurfaceFit
from ftp_dent_ros.profilometry.least_squares.fit.surface_mask import beside_steep_rim, between_lit
from ftp_dent_ros.profilometry.least_squares.fringe_orders.coded_surfaces import CodedSurfaces
from ftp_dent_ros.profilometry.least_squares.fringe_orders.stripe_surfaces import StripeSurfaces
from ftp_dent_ros.profilometry.least_squares.fringe_orders.surfaces import Surfaces
from ftp_dent_ros.profilometry.lit_area import WINDOWED, LitArea
from ftp_dent_ros.profilometry.measurement import Measurement
from ftp_dent_ros.profilometry.mirror_check import check_upright
from ftp_dent_ros.profilometry.pattern_check import check_pattern, other_frame
from ftp_dent_ros.profilometry.phase_geometry import PhaseGeometry
from ftp_dent_ros.profilometry.projector_rows import Rows
from ftp_dent_ros.profilometry.rows_check import check_rows
from ftp_dent_ros.rig.rig import Rig
from ftp_dent_ros.robust import median

# Standard deviation of a phase that is published, radians: three are the jump between nodes
# beyond which unwrapping takes the next fringe.
_LARGEST_DEVIATION = math.pi / 6
# Fringes between two surfaces whose ends are each other's: the margins of both, and the blur.
_NEAR = 2.0


class LeastSquares:
    """The method for one rig and pattern.

    From the second frame on nothing large stays allocated: tables, work arrays and up to three
    clouds are kept, and what else a frame needs on its way (20 bytes a pixel at most) is let go.

    Parameters
    ----------
    rig : Rig
    pattern : Pattern
    stride : int
        The cloud has every `stride`-th pixel, along rows and columns.
    """

    def __init__(self, rig: Rig, pattern: Pattern, stride: int = 1) -> None:
        self.rig, self.pattern = rig, pattern
        self._depth = 4 * float(np.linalg.norm(rig.translation))
        self.period = carrier_on(rig, pattern, ReferencePlane(self._depth)).period
        self.grid = Grid.for_fringes(rig.camera.width, rig.camera.height, self.period)
        self.windows = Windows.for_fringes(self.period, self.grid)
        bins = PhaseGeometry.of(rig, pattern, *self.grid.bin_positions())
        self._bin_rays = bins.rays
        self._nodes = PhaseGeometry.of(rig, pattern, *self.grid.node_positions())
        self._table = ReferenceTable.of(self.grid, self.windows, bins, self._nodes, self._depth)
        fit = SurfaceFit(pattern, self.period, self.grid, self.windows, self._nodes, self._table)
        self._surfaces: Surfaces = (
            CodedSurfaces(fit) if pattern.code == 'contrast' else StripeSurfaces(fit)
        )
        self._builder = CloudBuilder(rig, self.grid, stride)

    def measure(self, photograph: Photograph) -> Measurement:
        """Measure the surfaces in a photograph.

        Raises
        ------
        TooDarkError, SaturatedError, NoStripeError, OtherPatternError
        """
        light, lit, seams, surfaces = self._fitted(photograph)
        power = self._light_power(photograph, light, surfaces)
        if power != 1:
            light, lit, seams, surfaces = self._fitted(photograph.to_the_power(power))
        surfaces = in_register(surfaces, photograph, self.grid, self.windows, self.pattern)
        return self._result(light, lit, seams, surfaces, self._lit_area(surfaces))

    def _fitted(
        self, photograph: Photograph
    ) -> tuple[IntensityBins, NDArray[np.bool_], NDArray[np.bool_], list[FittedSurface]]:
        """Light, where it is of one surface, and of two, and the surfaces in it."""
        light = IntensityBins.of(photograph, self.grid, self.pattern.code == 'stripe')
        fringes = fit(self.grid, self.windows, self._table, light.red)
        lit, seams = fringe_region(
            *(fringes, self.windows, self.grid, self.period),
            self.pattern.faintest_contrast,
        )
        check_exposure(light, lit, self.grid, self.period)
        return light, lit, seams, self._surfaces.fitted(light, fringes, lit, seams)

    def _light_power(
        self, photograph: Photograph, light: IntensityBins, surfaces: list[FittedSurface]
    ) -> float:
        """Power of the photograph's levels that grows with the light, by coded fringes."""
        power = 1.0
        if self.pattern.code != 'contrast':
            return power
        part = max(surfaces, key=lambda each: np.count_nonzero(each.refined.measured))
        # Bins average levels, not light: once more of levels that nearly are light.
        for _ in range(2):
            more = light_power(
                *(self.pattern, self.grid, self.windows, light, part.phase),
                part.refined.measured,
            )
            power *= more
            if more == 1:
                break
            light = IntensityBins.of(photograph.to_the_power(power), self.grid, stripe=False)
        return power

    def _lit_area(self, fitted: list[FittedSurface]) -> LitArea:
        """Where the surfaces have fringes."""
        first, *others = fitted
        phase, lit = self.grid.at_bins(first.phase), first.refined.measured
        for part in others:
            measured = part.refined.measured
            phase, lit = np.where(measured, self.grid.at_bins(part.phase), phase), lit | measured
        # Windows know the light to a bin's middle, the area to its end.
        short = WINDOWED - self.grid.step / self.period / 2
        return LitArea(self.rig, self.pattern, self._bin_rays, phase, lit, short)

    def _result(self, light, lit, seams, fitted, area) -> Measurement:
        """Publish the surfaces together."""
        confirmed = check_pattern(area)
        if self.pattern.code == 'stripe' and not confirmed:
            check_upright(area, 1e-3)
        grid, period = self.grid, self.period / self.grid.step
        around: Any = np.ones((5, 2 * math.ceil(period) + 1), np.uint8)
        beside_dark = cv2.dilate(grid.to_bins(~lit).view(np.uint8), around)
        surfaces, depths, rows = [], [], []
        on_panel = np.zeros(grid.shape, bool)
        for part in fitted:
            refined, region = part.refined, part.region
            inverse_depth, v_p = self._nodes.meet(part.phase)
            within = self._within_panel(part.phase, v_p)
            # The dark beyond the panel's end is known; where none is, none is taken in.
            at_end = cv2.dilate((~within).view(np.uint8), around) > 0
            at_end |= beside_dark == 0
            told = between_lit(refined.told | at_end, period)
            sure = grid.to_bins(refined.shift.variance < _LARGEST_DEVIATION**2)
            measured = refined.measured & within & told & sure
            steep = beside_steep_rim(measured | at_end, period) & ~at_end
            doubtful = steep | (refined.measured & within & ~measured)
            variance = refined.shift.variance + refined.shift.foreign
            deviation = self._nodes.deviation(part.phase, variance)
            surfaces.append(
                Published(
                    np.nan_to_num(inverse_depth, nan=1.0),
                    refined.modulation,
                    deviation,
                    refined.wavelength,
                    measured,
                    refined.covered * ~doubtful,
                )
            )
            if self.pattern.tells_rows:
                rows.append(self._rows(part, v_p, measured))
            at_stripe = region & (np.abs(part.phase) < math.pi)
            depths.append(1 / inverse_depth[at_stripe])
            on_panel |= region & self._any_bin(within)
        reach = math.ceil(_NEAR * self.period / grid.rows), math.ceil(_NEAR * period)
        beyond = [(lit | seams) & ~part.region for part in fitted]
        doubted = [
            near(grid.to_bins(surfaces_in(each)), reach) & part.refined.astray
            for each, part in zip(beyond, fitted, strict=True)
        ]
        surfaces = parted(surfaces, doubted, reach)
        published = np.any([self._any_bin(each.measured) for each in surfaces], axis=0)
        depth = np.concatenate(depths)
        reason = 'unnumbered' if self.pattern.code == 'contrast' else 'untied'
        coverage = Coverage.of(
            eroded(lit | seams),
            published,
            clipped=self._any_bin(light.clipped),
            **{reason: ~np.any([part.region for part in fitted], axis=0)},
            off_panel=~on_panel,
        )
        stripe_depth = median(depth)
        coverage = replace(coverage, confirmed=confirmed)
        epipolar = check_epipolar(self.rig, self.pattern, rows, WIDTH * self.pattern.period_px)
        if epipolar is not None:
            other = other_frame(area)
            check_rows(self.pattern, epipolar, other, self._under(other, fitted, rows))
        return Measurement(
            self._builder.cloud(surfaces), stripe_depth, coverage, epipolar=epipolar
        )

    def _under(self, other: Pattern | None, fitted, rows) -> EpipolarCheck | None:
        """What the rows of surfaces say if the pattern is another than the one told."""
        if other is None:
            return None
        nodes = PhaseGeometry.of(self.rig, other, *self.grid.node_positions())
        moved = [
            replace(each, u_p=other.column(part.phase), v_p=nodes.meet(part.phase)[1])
            for part, each in zip(fitted, rows, strict=True)
        ]
        return check_epipolar(self.rig, other, moved, WIDTH * other.period_px)

    def _rows(self, part: FittedSurface, v_p, measured) -> Rows:
        """What a surface shows of the projector's rows."""
        refined = part.refined
        contrast = refined.modulation / np.maximum(refined.level, 1)
        seen = eroded(self._all_bins(measured))
        return Rows(self.pattern.column(part.phase), v_p, contrast, seen, self._nodes.rays)

    def _any_bin(self, bins):
        """Nodes whose outer bins are in a mask."""
        return bins[:, :: self.grid.bins] | bins[:, self.grid.bins - 1 :: self.grid.bins]

    def _all_bins(self, bins):
        """Nodes whose outer bins both are in a mask."""
        return bins[:, :: self.grid.bins] & bins[:, self.grid.bins - 1 :: self.grid.bins]

    def _within_panel(self, phase, v_p) -> NDArray[np.bool_]:
        """Bins that the projector's panel reaches, but for its blurred rim."""
        projector = self.rig.projector
        inset = 1.5
        # A bin is measured where its outer row of pixels is within the panel too.
        half = (self.grid.rows - 1) / 2 * self.pattern.period_px / self.period
        high = max(inset, half)
        u_p = self.pattern.column(phase).astype(np.float32)
        inside = (u_p > inset) & (u_p < projector.width - 1 - inset)
        inside &= (v_p > high) & (v_p < projector.height - 1 - high)
        return self.grid.to_bins(inside)
