"""Windowed least squares about the analytic reference: the default method, one line a step."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.errors import NoFringesError, NoStripeError
from ftp_dent_ros.pattern import Pattern
from ftp_dent_ros.photograph import Photograph
from ftp_dent_ros.profilometry.carrier import ReferencePlane, carrier_on
from ftp_dent_ros.profilometry.coverage import Coverage
from ftp_dent_ros.profilometry.least_squares.cloud_builder import CloudBuilder, Published
from ftp_dent_ros.profilometry.least_squares.exposure import check_exposure, check_fringes
from ftp_dent_ros.profilometry.least_squares.extrapolation import Extrapolation
from ftp_dent_ros.profilometry.least_squares.first_fit import ReferenceTable, fit
from ftp_dent_ros.profilometry.least_squares.frame_rim import FrameRim
from ftp_dent_ros.profilometry.least_squares.fringe_order import joined, off_frame, untied
from ftp_dent_ros.profilometry.least_squares.grid import Grid
from ftp_dent_ros.profilometry.least_squares.intensity_bins import IntensityBins
from ftp_dent_ros.profilometry.least_squares.median import median
from ftp_dent_ros.profilometry.least_squares.phase_geometry import PhaseGeometry
from ftp_dent_ros.profilometry.least_squares.quadric import evaluate, robust_quadric
from ftp_dent_ros.profilometry.least_squares.refinement import Refined, Refinement
from ftp_dent_ros.profilometry.least_squares.regions import (
    apart,
    edges,
    eroded,
    fringe_region,
    rim_strips,
    separated,
    sighted,
)
from ftp_dent_ros.profilometry.least_squares.surface_mask import roughness
from ftp_dent_ros.profilometry.least_squares.windows import Windows
from ftp_dent_ros.profilometry.lit_area import LitArea
from ftp_dent_ros.profilometry.measurement import Measurement
from ftp_dent_ros.profilometry.pattern_check import check_pattern
from ftp_dent_ros.profilometry.stripe import stripe_orders
from ftp_dent_ros.profilometry.unwrapping import Unwrapped, unwrap
from ftp_dent_ros.rig import Rig

# Rows of bins in which the stripe is looked for.
_STRIPE_ROWS = 15
# Between nodes one above the other, radians: a quarter of a fringe.
_JUMP = math.pi / 2
# Fits of a surface, each without what the last one found not to be a part of it.
_FITS = 3
_TURN = 2 * math.pi
# Fringes' periods go in steps, so that one table of windows serves many surfaces.
_PERIOD_STEP, _LONGEST = 1.08, 1.6
# Such steps by which windows are narrower where a surface is no skin: to 0.4 fringes, chosen on
# photographs of one relief.
_FINER = 3
# Nodes that the quadric is fitted to, about.
_POINTS = 600


@dataclass(frozen=True, eq=False)
class _Part:
    """A surface on which the stripe was seen."""

    refined: Refined
    phase: NDArray[np.float32]


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
    fast : bool
        Correct the model once, not twice.
    """

    def __init__(self, rig: Rig, pattern: Pattern, stride: int = 1, fast: bool = False) -> None:
        self.rig, self.pattern = rig, pattern
        self._depth = 4 * float(np.linalg.norm(rig.translation))
        self.period = carrier_on(rig, pattern, ReferencePlane(self._depth)).period
        self.grid = Grid.for_fringes(rig.camera.width, rig.camera.height, self.period, fast)
        self.windows = Windows.for_fringes(self.period, self.grid)
        bins = PhaseGeometry.of(rig, pattern, *self.grid.bin_positions())
        self._bin_rays = bins.rays
        self._nodes = PhaseGeometry.of(rig, pattern, *self.grid.node_positions())
        self._table = ReferenceTable.of(self.grid, self.windows, bins, self._nodes, self._depth)
        self._fast = fast
        self._refinement = lru_cache(maxsize=4)(self._refinement_at)
        self._builder = CloudBuilder(rig, self.grid, stride)

    def measure(self, photograph: Photograph) -> Measurement:
        """Measure the surfaces in a photograph.

        Raises
        ------
        TooDarkError, SaturatedError, NoStripeError, OtherPatternError
        """
        light = IntensityBins.of(photograph, self.grid)
        table = self._table
        fringes = fit(self.grid, self.windows, table, light.red)
        lit, seams = fringe_region(fringes, self.windows, self.grid, self.period)
        check_exposure(light, lit, self.grid, self.period)
        phase, part, orders = self._absolute(light, table, fringes, lit, seams)
        foreign = np.arange(1, part.max() + 3)
        foreign[list(orders)], foreign[-1] = 0, 0
        others = foreign[part]
        parts, regions, refusals = [], [], []
        for label, order in orders.items():
            try:
                surface, region = self._surface(
                    light, lit, seams, part == label, others, phase - np.float32(_TURN * order)
                )
            except (NoFringesError, NoStripeError) as reason:
                refusals.append(reason)
                continue
            parts.append(surface)
            regions.append(region)
        if not parts:
            raise refusals[-1]
        return self._result(light, lit, parts, regions, self._check_pattern(parts))

    def _check_pattern(self, parts: list[_Part]) -> bool:
        """Raise if the fringes cannot be those of the pattern told; whether no other's."""
        surfaces = [(self.grid.at_bins(part.phase), part.refined.measured) for part in parts]
        return check_pattern(LitArea.of(self.rig, self.pattern, self._bin_rays, surfaces))

    def _absolute(self, light, table, fringes, lit, seams):
        """Phase at the nodes, the part each is tied to, and the stripe's order by part."""
        unwrapped = unwrap(fringes.shift, lit, jump=_JUMP)
        try:
            orders = self._orders(light, table, unwrapped)
        except NoStripeError:
            # Two surfaces may have been taken for one: cut along edges, and vote again.
            phase = table.phase + self.grid.at_bins(unwrapped.phase)
            model = self.grid.at_bins(fringes.level)
            amplitude = self.grid.at_bins(fringes.modulation)
            misfit = (light.red - model - amplitude * np.cos(phase)) / np.maximum(amplitude, 1)
            rough = roughness(misfit, self.windows, self.grid)
            cut = separated(lit, edges(lit, seams, rough, self.grid, self.period))
            unwrapped = unwrap(fringes.shift, cut, jump=_JUMP)
            orders = self._orders(light, table, unwrapped)
        return table.node_phase + unwrapped.phase, unwrapped.part, orders

    def _orders(self, light: IntensityBins, table: ReferenceTable, unwrapped) -> dict[int, int]:
        """Fringe order at the stripe of each part that holds it."""
        rows = np.unique(np.linspace(0, self.grid.shape[0] - 1, _STRIPE_ROWS).astype(int))
        size = self.grid.bin_shape[1], len(rows)
        shift = cv2.resize(unwrapped.phase[rows], size, interpolation=cv2.INTER_LINEAR)
        part = self.grid.to_bins(unwrapped.part[rows])
        # Where it is interpolated across parts, the shift means nothing.
        part[:, 1:-1][(part[:, 1:-1] != part[:, 2:]) | (part[:, 1:-1] != part[:, :-2])] = -1
        return stripe_orders(table.phase[rows] + shift, part, light.red[rows], light.others(rows))

    def _surface(
        self, light, lit, seams, region, others, phase
    ) -> tuple[_Part, NDArray[np.bool_]]:
        """Fit one surface; once more if a part of it turns out not to be tied to the stripe."""
        place, table = (self.windows, self.grid, self.period), self._table
        reference = self._reference(region, phase)
        turns = joined(eroded(region), others * eroded(others > 0), phase - reference, *place)
        for label, number in turns.items():
            more = others == label
            region = region | more
            phase = phase + np.float32(_TURN * number) * more
        if turns:
            reference = self._reference(region, phase)
        refinement = self._refinement(self._period_step(reference, region))
        strips = rim_strips(region, lit, seams)
        foreign, seams = lit & ~region & ~strips, seams & ~strips
        relief = False
        for _ in range(_FITS):
            region = apart(region, foreign, seams, self.grid, self.period)
            sure = region if relief else sighted(region, self.windows)
            shift = Extrapolation(sure, self.windows).by_slope((phase - reference) * region)
            if refinement.windows.sigma_u > self.windows.sigma_u:
                # Narrow windows have let ripples through, which wide ones do not see.
                shift = refinement.windows.flat_top(shift)
            refined = refinement.refine(
                light, table.phase, reference - table.node_phase, shift, region | strips
            )
            check_fringes(refined.roughness[region])
            absolute = reference + refined.shift.values
            if relief:
                break
            if refined.relief:
                # What is no skin has edges everywhere: it is one surface as far as its phase is.
                relief, foreign = True, np.zeros_like(region)
                refinement = self._refinement(self._period_step(reference, region) - _FINER)
                continue
            at_stripe, rough = np.abs(absolute) < math.pi, refined.roughness
            lines = edges(region, seams, rough, self.grid, self.period)
            foreign = untied(region, lines, refined.shift.values, at_stripe, *place)
            rim = FrameRim.of(refined.measured, absolute, self.pattern, self.grid)
            if rim.off(rim.blocks()):
                lines = edges(region, seams, rough, self.grid, self.period, faint=True)
                foreign = foreign | off_frame(region, lines, at_stripe, rim)
            if not foreign.any():
                break
            self._check_stripe(light, phase, region & ~foreign)
            foreign = cv2.dilate(foreign.view(np.uint8), np.ones((9, 9), np.uint8)) > 0
            reference = self._reference(region & ~foreign, phase)
        return _Part(refined, absolute), region

    def _period_step(self, phase, region) -> int:
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

    def _check_stripe(self, light, phase, region) -> None:
        """Raise if what is left of a region does not hold the stripe, or another order's."""
        shift = phase - self._table.node_phase
        left = Unwrapped(shift, np.where(region, 0, -1).astype(np.int32))
        if self._orders(light, self._table, left)[0] != 0:
            raise NoStripeError(
                'the red stripe lies on the edge between two surfaces: move it onto one of them'
            )

    def _reference(self, region, phase) -> NDArray[np.float32]:
        """Phase at the nodes of the quadric through a region's first fit."""
        inner = eroded(region)
        chosen = inner if inner.sum() > 0.2 * region.sum() else region
        flat = np.flatnonzero(chosen)
        row, column = np.divmod(flat[:: max(1, len(flat) // _POINTS)], chosen.shape[1])
        points = self._nodes.at(row, column)
        inverse_depth, _ = points.meet(phase[row, column][None])
        met = np.isfinite(inverse_depth)
        if met.sum() < 6:
            raise NoStripeError(
                'the red stripe is seen where the projector cannot light it: check that rig.yaml '
                'and the pattern belong to this camera and projector'
            )
        quadric = robust_quadric(points.rays[met], inverse_depth[met])
        return self._nodes.phase(evaluate(quadric, self._nodes.rays))

    def _result(self, light, lit, parts, regions, confirmed) -> Measurement:
        """Publish the surfaces together."""
        grid = self.grid
        surfaces, depths = [], []
        published, on_panel = np.zeros(grid.shape, bool), np.zeros(grid.shape, bool)
        for part, region in zip(parts, regions, strict=True):
            refined = part.refined
            inverse_depth, v_p = self._nodes.meet(part.phase)
            within = self._within_panel(part.phase, v_p)
            measured = refined.measured & within
            deviation = self._nodes.deviation(part.phase, refined.shift.variance)
            surfaces.append(
                Published(
                    np.nan_to_num(inverse_depth, nan=1.0),
                    refined.modulation,
                    deviation,
                    refined.wavelength,
                    measured,
                    refined.covered,
                )
            )
            at_stripe = region & (np.abs(part.phase) < math.pi)
            depths.append(1 / inverse_depth[at_stripe])
            published |= self._any_bin(measured)
            on_panel |= region & self._any_bin(within)
        depth = np.concatenate(depths)
        coverage = Coverage.of(
            eroded(lit),
            published,
            clipped=self._any_bin(light.clipped),
            untied=~np.any(regions, axis=0),
            off_panel=~on_panel,
        )
        stripe_depth = float(np.median(depth)) if len(depth) else math.nan
        coverage = replace(coverage, confirmed=confirmed)
        return Measurement(self._builder.cloud(surfaces), stripe_depth, coverage)

    def _any_bin(self, bins):
        """Nodes whose outer bins are in a mask."""
        return bins[:, :: self.grid.bins] | bins[:, self.grid.bins - 1 :: self.grid.bins]

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
