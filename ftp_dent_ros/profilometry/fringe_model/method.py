"""The method on one page: light, start, fringe orders, solution, points, checks."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.cloud.coverage import Coverage
from ftp_dent_ros.errors import NoStripeError, SaturatedError, TooDarkError
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.photograph.photograph import Photograph
from ftp_dent_ros.profilometry.checks.epipolar import EpipolarCheck, check_epipolar, check_rows
from ftp_dent_ros.profilometry.checks.frame import check_frame
from ftp_dent_ros.profilometry.checks.rows import Rows
from ftp_dent_ros.profilometry.fourier_transform.carrier import ReferencePlane, carrier_on
from ftp_dent_ros.profilometry.fringe_model.bins import WIDTH, BinGrid, GridGeometry, Nearest
from ftp_dent_ros.profilometry.fringe_model.light import Light
from ftp_dent_ros.profilometry.fringe_model.local_fit import LocalFit, Windows
from ftp_dent_ros.profilometry.fringe_model.orders import WORD, OrderLikelihood
from ftp_dent_ros.profilometry.fringe_model.paint import divide_paint
from ftp_dent_ros.profilometry.fringe_model.pixels import RIM, Pixels, Sheet
from ftp_dent_ros.profilometry.fringe_model.points import Points
from ftp_dent_ros.profilometry.fringe_model.register import lead_of_paint
from ftp_dent_ros.profilometry.fringe_model.solver import FringeFit, Solver
from ftp_dent_ros.profilometry.fringe_model.start import (
    LEAST_NODES,
    PLANES,
    Plane,
    Start,
    fit_planes,
)
from ftp_dent_ros.profilometry.fringe_model.surfaces import Surfaces
from ftp_dent_ros.profilometry.fringe_model.waveform import Waveform
from ftp_dent_ros.profilometry.measurement import Measurement
from ftp_dent_ros.rig.rig import Rig
from ftp_dent_ros.robust import median


class FringeModel:
    """The method for one rig and pattern, with its tables.

    Parameters
    ----------
    rig : Rig
    pattern : Pattern
    stride : int
        The cloud has every `stride`-th pixel, along rows and columns.
    """

    def __init__(self, rig: Rig, pattern: Pattern, stride: int = 1) -> None:
        self.rig, self.pattern, self.stride = rig, pattern, stride
        baseline = float(np.linalg.norm(rig.translation))
        period = carrier_on(rig, pattern, ReferencePlane(4 * baseline)).period
        self.grid = BinGrid.of(rig.camera.width, rig.camera.height, period)
        self._geometry = GridGeometry.of(rig, pattern, self.grid)
        self._planes = [Plane.of(self._geometry, distance * baseline) for distance in PLANES]
        self._waveform, self._coded = Waveform.of(pattern), Waveform.of(pattern, 'blue')
        # Fringes from the stripe within which it shows its blur: its own, and a window.
        self._shown = math.inf if pattern.code == 'contrast' else 0.5 + 2 * WIDTH
        # Two contrasts in a window: each is half the step off, and a cosine's square is a half.
        self._steps = (1 - pattern.faintest_contrast) ** 2 / 8
        self._likelihood = OrderLikelihood(pattern)

    def measure(self, photograph: Photograph) -> Measurement:
        """Measure the surfaces in a photograph.

        Raises
        ------
        SaturatedError, TooDarkError, NoStripeError, OtherPatternError
        """
        sheets, depth, coverage, rows, waveform = self._surfaces(photograph)
        return Measurement(self._pixels.cloud(sheets), depth, coverage, rows, waveform)

    def _surfaces(
        self, photograph: Photograph
    ) -> tuple[list[Sheet], float, Coverage, EpipolarCheck | None, Waveform]:
        """Surfaces of points; and of a measurement all but the cloud."""
        grid = self.grid
        stripe = self.pattern.code == 'stripe'
        light = Light.of(photograph, grid, stripe)
        start = self._started(light)
        light, start = divide_paint(photograph, grid, light, start, self._started)
        usable = grid.at_nodes(light.usable)
        clipped = usable < 1 - usable
        fringes = start.surface >= 0
        _check_light(clipped, fringes)
        orders, numbered = self._likelihood.numbered(grid, light, start)
        surfaces = Surfaces.of(self._geometry, start, orders, numbered)
        lit, onwards = surfaces.ends(grid, light, start)
        usable = light.usable * self._on_panel(surfaces.phase)
        usable *= surfaces.solvable(grid, lit, start)
        grey, colours = self._filled(light, start, surfaces.phase)
        lead = np.zeros(grid.node_shape, np.float32)
        if len(light.colours) > 1:
            lead = lead_of_paint(grid, start.colours, light.shares, colours)
        waveform = self._blurred(light, usable, surfaces.phase, surfaces.known)
        weight = usable * light.weight * light.certain
        del light, start  # for the memory that the solver takes
        fit = Solver(grid, grey, usable, weight).solve(surfaces, waveform)
        fit = replace(fit, phase=fit.phase - grid.at_bins(Nearest(colours)(lead)))
        points = self._points(grey, usable, surfaces, fit)
        coverage = Coverage.of(
            fringes,
            points.measured,
            clipped=clipped,
            **{'untied' if stripe else 'unnumbered': surfaces.number < 0},
        )
        at_nodes = grid.at_nodes(onwards), grid.at_nodes(lit.astype(np.float32)) > 0.5
        coverage = replace(coverage, confirmed=check_frame(self.pattern, *at_nodes))
        rows = self._rows(fit, points)
        return points.sheets, points.stripe_depth, coverage, rows, fit.waveform

    @cached_property
    def _pixels(self) -> Pixels:
        return Pixels(self.rig, self.grid, self.stride)

    def _started(self, light: Light) -> Start:
        """The first fit."""
        return fit_planes(self.grid, light, self._planes, self._steps)

    def _on_panel(self, phase: NDArray[np.float32]) -> NDArray[np.bool_]:
        """Bins that the panel lights, but for its blurred rim."""
        within = self._geometry.nodes.within_panel(self.grid.at_nodes(phase))
        return np.asarray(self.grid.at_bins(within) > RIM)

    def _filled(
        self, light: Light, start: Start, phase: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        """Grey light, a stripe filled from red by their ratio around it, and nodes around it."""
        if not light.has_stripe:
            return light.grey, start.fringes
        # The blurred stripe takes of green and blue in the fringes beside it, too.
        around = np.abs(self.grid.at_nodes(phase)) > (1 + 2 * WIDTH) * math.tau
        around &= start.fringes
        nearest = Nearest(around)
        other = LocalFit.of_mixture(start.colours[1:], light.shares[1:])
        ratio = other.swing / np.maximum(start.own.swing, 1)
        filled = self.grid.at_bins(nearest(other.level - ratio * start.own.level))
        filled += (light.shares[0] + self.grid.at_bins(nearest(ratio))) * light.unbroken
        return np.where(np.abs(phase) < math.tau, filled, light.grey), around

    def _blurred(self, light: Light, usable, phase, fringes) -> Waveform:
        """The waveform in the blur that the code shows in a strip with most of its fringes."""
        grid = self.grid
        shown = fringes & (np.abs(grid.at_nodes(phase)) < self._shown * math.tau)
        if not shown.any():
            return self._waveform
        high = min(len(shown), math.ceil(WORD * grid.fringe[1]))
        count = np.convolve(shown.sum(axis=1), np.ones(high), mode='valid')
        rows = slice(int(count.argmax()), int(count.argmax()) + high)
        columns = np.flatnonzero(shown[rows].any(axis=0))
        near = slice(columns[0], columns[-1] + 1)
        bins = rows, slice(near.start * grid.node, near.stop * grid.node)
        strip = grid.part(rows, near)
        coded, usable, phase = (each[bins] for each in (light.coded, usable, phase))
        shown, across = shown[rows, near], grid.across[bins[1]]
        words = int(strip.width / (WORD * grid.period))
        thirds = np.array_split(columns, max(1, min(3, words, len(columns))))

        def left(waveform: Waveform) -> NDArray[np.floating]:
            # The code's steps have shifted the phase by how they are blurred.
            first = Windows(strip, *waveform.at(phase, across), usable).fit(coded)
            own = phase + strip.at_bins(first.shift)
            rest = Windows(strip, *waveform.at(own, across), usable).fit(coded).rest
            of_thirds = ((rest[:, c - near.start], shown[:, c - near.start]) for c in thirds)
            return np.array([median(each[there]) for each, there in of_thirds])

        places = np.array([each.mean() for each in thirds]) / (fringes.shape[1] - 1) - 0.5
        return self._waveform.in_blur(*self._coded.least_blur(left, places))

    def _points(self, grey, usable, surfaces: Surfaces, fit: FringeFit) -> Points:
        """The points of all surfaces."""
        points = Points(self._geometry, fit, usable, grey)
        for number in range(surfaces.number.max() + 1):
            points.add(surfaces.number == number)
        if not points.measured.any():
            raise NoStripeError(
                'the fringes are seen where the projector cannot light a surface: check that '
                'rig.yaml and the pattern belong to this camera and projector'
            )
        return points

    def _rows(self, fit: FringeFit, points: Points) -> EpipolarCheck | None:
        """What the rows of the projector say of pattern and rig."""
        phase = np.full(self.grid.node_shape, np.nan, np.float32)
        for surface, certain in points.surfaces:
            phase[certain] = surface[certain]
        contrast = self.grid.at_nodes(fit.amplitude) / np.maximum(self.grid.at_nodes(fit.level), 1)
        column, (_, v_p) = self.pattern.column(phase), self._geometry.nodes.meet(phase)
        rows = Rows(column, v_p, contrast, np.isfinite(phase), self._geometry.nodes.rays)
        window = WIDTH * self.pattern.period_px
        found = check_epipolar(self.rig, self.pattern, rows, window)
        if found is not None:
            check_rows(self.pattern, found)
        return found


def _check_light(clipped: NDArray[np.bool_], fringes: NDArray[np.bool_]) -> None:
    """Raise the reason if most of the light is clipped, or none has fringes."""
    count, rest = (int(np.count_nonzero(each)) for each in (clipped, fringes & ~clipped))
    if count > max(rest, LEAST_NODES):
        raise SaturatedError(
            f'the fringes are clipped over {count / (count + rest):.0%} of the lit area: expose '
            'for a shorter time'
        )
    if not fringes.any():
        raise TooDarkError(
            'no part of the image shows fringes of the given pattern: switch the projector on, '
            'face the skin, come closer, expose longer, or give the pattern that is projected '
            '(pattern.yaml)'
        )
