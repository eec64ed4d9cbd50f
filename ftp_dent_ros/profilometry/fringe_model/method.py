"""The method on one page: light, start, fringe orders, solution, points."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.cloud.coverage import Coverage
from ftp_dent_ros.errors import (
    NoStripeError,
    RefusedFrameError,
    SaturatedError,
    TooDarkError,
)
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.photograph.photograph import Photograph
from ftp_dent_ros.profilometry.carrier import ReferencePlane, carrier_on
from ftp_dent_ros.profilometry.fringe_model.bins import BinGrid, nearest
from ftp_dent_ros.profilometry.fringe_model.checks import check_surfaces
from ftp_dent_ros.profilometry.fringe_model.light import Light
from ftp_dent_ros.profilometry.fringe_model.local_fit import fit_windows
from ftp_dent_ros.profilometry.fringe_model.orders import WORD, OrderLikelihood
from ftp_dent_ros.profilometry.fringe_model.points import Points
from ftp_dent_ros.profilometry.fringe_model.solver import FringeFit, Solver
from ftp_dent_ros.profilometry.fringe_model.start import Start, fit_planes, plane_phases
from ftp_dent_ros.profilometry.fringe_model.waveform import Waveform
from ftp_dent_ros.profilometry.least_squares.phase_geometry import PhaseGeometry
from ftp_dent_ros.profilometry.measurement import Measurement
from ftp_dent_ros.profilometry.pattern_check import other_code
from ftp_dent_ros.rig.rig import Rig

_TURN = 2 * math.pi
# Fringes beyond the nodes of a surface within which its bins may go on.
_BEYOND = 1.0
# Fringes over which the start is smooth, and what it may differ by from the first fit, radians.
_SMOOTH, _OFF = 0.5, 1.0
# Half width of what the blurred stripe takes of green and blue: a fringe.
_STRIPE = _TURN
# Least mean weight and amplitude (levels) of windows that tell the ratio of grey to red.
_WEIGHT, _AMPLITUDE = 0.1, 1.0
# Nodes that a surface has at least: two rows of windows over some fringes.
_LEAST_NODES = 30

# Share of a node's bins that is clipped where no phase is left, and of what is lit, at most.
_CLIPPED, _MOST = 0.4, 0.5

_CLIPPED_SENTENCE = (
    'the fringes are clipped over {:.0%} of the lit area: expose for a shorter time'
)
_DARK = (
    'no part of the image shows fringes: switch the projector on, come closer, or expose longer'
)
_UNLIT = (
    'the fringes are seen where the projector cannot light a surface: check that rig.yaml and the '
    'pattern belong to this camera and projector'
)
_UNNUMBERED = {
    'stripe': (
        'the red stripe is not seen on any surface: bring it into view on a surface that reflects '
        'green and blue, and give the rig.yaml and the pattern of this camera and projector'
    ),
    'contrast': (
        'no surface shows the code of the pattern: bring eight fringes side by side onto one '
        'surface, in focus, and give the pattern that is projected (pattern.yaml)'
    ),
}


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
        self._bins = PhaseGeometry.of(rig, pattern, *self.grid.bin_positions())
        self._nodes = PhaseGeometry.of(rig, pattern, *self.grid.node_positions())
        self._planes = plane_phases(self._bins, self._nodes, self.grid, baseline)
        self._waveform = Waveform.of(pattern)
        self._likelihood = OrderLikelihood(pattern)
        self._solver = Solver(self.grid)

    def measure(self, photograph: Photograph) -> Measurement:
        """Measure the surfaces in a photograph.

        Raises
        ------
        SaturatedError, TooDarkError, NoStripeError, OtherPatternError
        """
        light = Light.of(photograph, self.grid)
        start = fit_planes(self.grid, light.red, light.usable, self._planes)
        orders, numbered = self._orders(light, start)
        phase, surface = self._absolute(start, orders, numbered)
        plain = self._filled(light, phase)
        first = self._first(plain, light.usable, phase, start.surface >= 0)
        fit = self._solver.solve(plain, light.usable, start.reference, first)
        geometry = self.rig, self.pattern, self.grid, self._bins, self._nodes
        points = Points(*geometry, self.stride, fit, light.usable)
        for number in orders:
            points.add(surface == number, start.reference)
        if not points.measured.any():
            raise NoStripeError(_UNLIT)
        fringes = self.grid.repeated(start.surface >= 0)
        reason = 'untied' if self.pattern.code == 'stripe' else 'unnumbered'
        coverage = Coverage.of(
            fringes, points.measured, clipped=light.usable == 0, **{reason: surface < 0}
        )
        confirmed, epipolar = check_surfaces(
            *(self.rig, self.pattern, self.grid, self._bins, fit, points.surfaces)
        )
        coverage = replace(coverage, confirmed=confirmed)
        return Measurement(points.cloud, points.stripe_depth, coverage, epipolar)

    def _orders(self, light: Light, start: Start) -> tuple[dict[int, int], NDArray[np.int32]]:
        """Fringe orders that have the odds, and the number of each node's, -1 without."""
        fringes = start.surface >= 0
        clipped = self.grid.at_nodes(light.usable) < _CLIPPED
        count = np.count_nonzero(clipped)
        share = count / np.count_nonzero(clipped | fringes) if count > _LEAST_NODES else 0.0
        if share > _MOST:
            raise SaturatedError(_CLIPPED_SENTENCE.format(share))
        if not fringes.any():
            raise TooDarkError(_DARK)
        ratio, weight = self._code(light, start)
        sizes = np.bincount(start.surface[fringes])
        orders: dict[int, int] = {}
        surface = np.full(start.surface.shape, -1, np.int32)
        for number in np.flatnonzero(sizes >= _LEAST_NODES):
            nodes = start.surface == number
            for order, part in self._likelihood.parts(
                start.phase, ratio, weight, nodes, self.grid.fringe[1]
            ):
                surface[part] = len(orders)
                orders[len(orders)] = order
        if not orders:
            raise self._unnumbered(start)
        return orders, surface

    def _unnumbered(self, start: Start) -> RefusedFrameError:
        """Why no surface has a number: enough fringes with another code, or too few."""
        sizes = np.bincount(start.surface[start.surface >= 0])
        largest = start.phase[start.surface == sizes.argmax()]
        if self.pattern.code == 'contrast' and np.ptp(largest) > WORD * _TURN:
            return other_code(self.pattern)
        return NoStripeError(_UNNUMBERED[self.pattern.code])

    def _code(self, light: Light, start: Start):
        """Amplitude of the coded light over the other's, and its weight (eq. 7)."""
        if self.pattern.code == 'contrast':
            return start.amplitude / np.maximum(start.level, 1), np.square(start.amplitude)
        phase = start.reference + self.grid.at_bins(start.away)
        fit = fit_windows(self.grid, light.other, np.cos(phase), -np.sin(phase), light.usable)
        red = np.maximum(start.amplitude, 1)
        variance = (fit.rest + start.rest + 0.1) / self.grid.bins_in_window
        return np.hypot(fit.amplitude, fit.slope) / red, np.square(red) / variance

    def _absolute(self, start: Start, orders: dict[int, int], numbered: NDArray[np.int32]):
        """Absolute phase of the bins, and the number of their surface, -1 far from all."""
        known = numbered >= 0
        turns = np.zeros(numbered.shape, np.float32)
        for number, order in orders.items():
            turns[numbered == number] = _TURN * order
        away = start.away + turns
        share = np.maximum(self.grid.smooth_nodes(known.astype(np.float32), _SMOOTH), 1e-3)
        smooth = self.grid.smooth_nodes(np.where(known, away, np.float32(0)), _SMOOTH) / share
        away = np.where(np.abs(smooth - away) < _OFF, smooth, away).astype(np.float32)
        along_u, along_v = self.grid.fringe
        size = [2 * math.ceil(_BEYOND * n) + 1 for n in (along_v, along_u / self.grid.node)]
        near = cv2.dilate(known.view(np.uint8), np.ones(size, np.uint8)) > 0
        near &= known | (start.surface < 0)
        surface = np.where(near, nearest(numbered, known), -1)
        phase = start.reference + self.grid.at_bins(nearest(away, known))
        return phase, self.grid.repeated(surface)

    def _filled(self, light: Light, phase) -> NDArray[np.float32]:
        """Grey light, whose stripe is filled from red by their ratio around it."""
        if self.pattern.code == 'contrast':
            return light.grey
        stripe = np.abs(phase) < _STRIPE
        wave, slope, outside = np.cos(phase), -np.sin(phase), light.usable * ~stripe
        red, grey = (
            fit_windows(self.grid, each, wave, slope, outside) for each in (light.red, light.grey)
        )
        known = (red.weight > _WEIGHT) & (red.amplitude > _AMPLITUDE)
        ratio = nearest(grey.amplitude / np.maximum(red.amplitude, 1), known)
        offset = nearest(grey.level - ratio * red.level, known)
        filled = self.grid.at_bins(offset) + self.grid.at_bins(ratio) * light.red
        return np.where(stripe, filled, light.grey)

    def _first(self, light, usable, phase, inside) -> FringeFit:
        """What the solver starts from."""
        fits = []
        for variance in self._waveform.variances:
            wave, slope, _ = self._waveform.at(phase, variance)
            fits.append(fit_windows(self.grid, light, wave, slope, usable))
        best = int(np.argmin([np.median(each.rest[inside]) for each in fits]))
        level, amplitude = map(self.grid.at_bins, (fits[best].level, fits[best].amplitude))
        blur = np.array([self._waveform.variances[best], 0.0, 0.0])
        return FringeFit(phase, level, amplitude, light, light, usable, self._waveform, blur)
