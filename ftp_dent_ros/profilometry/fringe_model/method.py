"""The method on one page: light, start, fringe orders, solution, points."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.cloud.coverage import Coverage
from ftp_dent_ros.errors import (
    NoStripeError,
    OtherPatternError,
    RefusedFrameError,
    SaturatedError,
    TooDarkError,
)
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.photograph.photograph import Photograph
from ftp_dent_ros.profilometry.checks.epipolar import EpipolarCheck, check_epipolar, check_rows
from ftp_dent_ros.profilometry.checks.frame import ADVICE, check_frame, described
from ftp_dent_ros.profilometry.checks.rows import Rows
from ftp_dent_ros.profilometry.fourier_transform.carrier import ReferencePlane, carrier_on
from ftp_dent_ros.profilometry.fringe_model.bins import (
    WIDTH,
    BinGrid,
    Nearest,
    dilated,
    wider_than_windows,
)
from ftp_dent_ros.profilometry.fringe_model.ends import lit_bins
from ftp_dent_ros.profilometry.fringe_model.light import Light
from ftp_dent_ros.profilometry.fringe_model.local_fit import LocalFit, Windows
from ftp_dent_ros.profilometry.fringe_model.orders import EXPLAINED, WORD, OrderLikelihood
from ftp_dent_ros.profilometry.fringe_model.pixels import RIM, Pixels, Sheet
from ftp_dent_ros.profilometry.fringe_model.points import Points, within_panel
from ftp_dent_ros.profilometry.fringe_model.quadric import quadric_through
from ftp_dent_ros.profilometry.fringe_model.register import lead_of_paint
from ftp_dent_ros.profilometry.fringe_model.solver import FringeFit, Solver
from ftp_dent_ros.profilometry.fringe_model.start import (
    LEAST_NODES,
    PLANES,
    Plane,
    Start,
    fit_planes,
)
from ftp_dent_ros.profilometry.fringe_model.waveform import Waveform
from ftp_dent_ros.profilometry.measurement import Measurement
from ftp_dent_ros.profilometry.phase_geometry import PhaseGeometry
from ftp_dent_ros.profilometry.unwrapping import wrap
from ftp_dent_ros.rig.rig import Rig

# Fringes beyond the nodes of a surface within which its bins may go on.
_BEYOND = 1.5
# Fringes over which the start is smooth, and what it may differ by from the first fit, radians.
_SMOOTH, _OFF = 0.5, 1.0
# Fringes that the strip is high which shows the code's blur first.
_STRIP = 10.0
# Half width of what the blurred stripe takes of green and blue: a fringe.
_STRIPE = math.tau

# Nodes to each side that a whole window has (two deviations), and in which another surface is seen
# (two fringes).
_WHOLE, _NEAR = 2, 5
# Share of a node's bins that is clipped where no phase is left, and of what is lit, at most.
_CLIPPED, _MOST = 0.4, 0.5

_CLIPPED_SENTENCE = (
    'the fringes are clipped over {:.0%} of the lit area: expose for a shorter time'
)
_DARK = (
    'no part of the image shows fringes of the given pattern: switch the projector on, come '
    'closer, expose longer, or give the pattern that is projected (pattern.yaml)'
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


@dataclass(frozen=True, eq=False)
class _Numbered:
    """Numbered fringes, and what else is known of a photograph before they are solved.

    Attributes
    ----------
    light, usable : ndarray, shape (rows, columns), float32
        Light that has fringes everywhere, and what of it the panel lights and is not clipped.
    phase, reference : ndarray, shape (rows, columns), float32
        Absolute, and that of smooth surfaces, radians.
    surface : ndarray, shape (rows, nodes), int32
        Number of the surface, -1 for none.
    fringes, clipped : ndarray of bool, shape (rows, nodes)
        Where a surface has fringes, and where its light is clipped.
    lead : ndarray, shape (rows, nodes), or None
        What paint makes of the phase, radians.
    area : (ndarray of bool, ndarray), shape (rows, columns)
        Bins between the ends of the light, and the phase there, radians.
    """

    light: NDArray[np.float32]
    usable: NDArray[np.float32]
    phase: NDArray[np.float32]
    reference: NDArray[np.float32]
    surface: NDArray[np.int32]
    fringes: NDArray[np.bool_]
    clipped: NDArray[np.bool_]
    lead: NDArray[np.float32] | None
    area: tuple[NDArray[np.bool_], NDArray[np.float32]]


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
        self._planes = [
            Plane.of(self.grid, self._bins, self._nodes, distance * baseline)
            for distance in PLANES
        ]
        self._waveform = Waveform.of(pattern)
        # Two contrasts in a window: each is half the step off, and a cosine's square is a half.
        self._steps = (1 - pattern.faintest_contrast) ** 2 / 8
        self._likelihood = OrderLikelihood(pattern)
        self._solver = Solver(self.grid)

    def measure(self, photograph: Photograph) -> Measurement:
        """Measure the surfaces in a photograph.

        Raises
        ------
        SaturatedError, TooDarkError, NoStripeError, OtherPatternError
        """
        sheets, depth, coverage, rows = self._solved(self._numbered(photograph))
        return Measurement(self._pixels.cloud(sheets), depth, coverage, rows)

    def _numbered(self, photograph: Photograph) -> _Numbered:
        """Fringes whose orders have the odds, and all that the solver starts from."""
        light = Light.of(photograph, self.grid, self.pattern.code == 'stripe')
        start = self._start(light)
        orders, numbered = self._orders(light, start)
        phase, reference, surface = self._absolute(start, orders, numbered)
        at_nodes = self.grid.at_nodes(phase)
        outside = np.abs(at_nodes) > _STRIPE + 2 * WIDTH * math.tau
        outside = start.fringes & (outside | (self.pattern.code == 'contrast'))
        plain = self._filled(light, start, phase, outside)
        lit = self._lit(at_nodes)
        area = lit_bins(self.grid, light, start, numbered >= 0, reference, phase)
        lead = None
        if len(light.colours) > 1:
            lead = Nearest(outside)(lead_of_paint(self.grid, start.colours, light.shares, outside))
        clipped = self.grid.at_nodes(light.usable) < _CLIPPED
        return _Numbered(
            plain,
            light.usable * lit * self._within_ends(area[0], numbered >= 0, start.surface >= 0),
            phase,
            reference,
            surface,
            start.surface >= 0,
            clipped,
            lead,
            area,
        )

    def _solved(
        self, given: _Numbered
    ) -> tuple[list[Sheet], float, Coverage, EpipolarCheck | None]:
        """Surfaces of points, the stripe's depth, what is covered, and the rows' check."""
        usable, phase = given.usable, given.phase
        waveform = self._waveform
        if waveform.has_code:
            waveform = self._blurred(given.light, usable, phase, given.fringes)
        fit = self._solver.solve(given.light, usable, given.reference, phase, waveform)
        if given.lead is not None:
            fit = replace(fit, phase=fit.phase - self.grid.at_bins(given.lead))
        geometry = self.rig, self.pattern, self.grid, self._bins, self._nodes
        points = Points(*geometry, fit, usable, given.light)
        for number in range(given.surface.max() + 1):
            points.add(given.surface == number)
        if not points.measured.any():
            raise NoStripeError(_UNLIT)
        reason = 'untied' if self.pattern.code == 'stripe' else 'unnumbered'
        coverage = Coverage.of(
            given.fringes,
            points.measured,
            clipped=given.clipped,
            **{reason: given.surface < 0},
        )
        lit, onwards = given.area
        confirmed = check_frame(self.rig, self.pattern, self._bins.rays, onwards, lit)
        epipolar = self._rows(fit, points)
        coverage = replace(coverage, confirmed=confirmed)
        return points.sheets, points.stripe_depth, coverage, epipolar

    @cached_property
    def _pixels(self) -> Pixels:
        return Pixels(self.rig, self.grid, self.stride)

    def _start(self, light: Light) -> Start:
        lights = light.unbroken, light.colours, light.usable
        return fit_planes(self.grid, *lights, self._planes, self._steps)

    def _within_ends(
        self, lit: NDArray[np.bool_], known: NDArray[np.bool_], fringes: NDArray[np.bool_]
    ) -> NDArray[np.bool_]:
        """Bins between the ends of the light, with whole windows on a surface, or near another."""
        whole = ~dilated(~known, _WHOLE, _WHOLE)
        near = dilated(wider_than_windows(fringes & ~known), _NEAR, _NEAR)
        return lit | self.grid.repeated(whole | near)

    def _rows(self, fit: FringeFit, points: Points) -> EpipolarCheck | None:
        """What the rows of the projector say of pattern and rig."""
        phase = np.full(self.grid.node_shape, np.nan, np.float32)
        for surface, certain in points.surfaces:
            phase[certain] = surface[certain]
        contrast = self.grid.at_nodes(fit.amplitude) / np.maximum(self.grid.at_nodes(fit.level), 1)
        _, v_p = self._nodes.meet(phase)
        column = self.pattern.column(phase)
        rows = Rows(column, v_p, contrast, np.isfinite(phase), self._nodes.rays)
        window = WIDTH * self.pattern.period_px
        found = check_epipolar(self.rig, self.pattern, rows, window)
        if found is not None:
            check_rows(self.pattern, found)
        return found

    def _orders(self, light: Light, start: Start) -> tuple[dict[int, int], NDArray[np.int32]]:
        """Fringe orders that have the odds, and the number of each node's, -1 without."""
        fringes = start.surface >= 0
        clipped = self.grid.at_nodes(light.usable) < _CLIPPED
        count = np.count_nonzero(clipped)
        share = count / np.count_nonzero(clipped | fringes) if count > LEAST_NODES else 0.0
        if share > _MOST:
            raise SaturatedError(_CLIPPED_SENTENCE.format(share))
        if not fringes.any():
            raise TooDarkError(_DARK)
        ratio, weight = self._code(light, start)
        orders: dict[int, int] = {}
        surface = np.full(start.surface.shape, -1, np.int32)
        unexplained = 0.0  # of all surfaces' nodes, beyond what may be
        sizes = np.bincount(start.surface[fringes])
        for number in np.flatnonzero(sizes):
            nodes = start.surface == number
            parts, explained = self._likelihood.parts(
                start.phase, ratio, weight, nodes, self.grid.fringe[1]
            )
            unexplained += np.nan_to_num((EXPLAINED - explained) * sizes[number])
            for order, part in parts:
                surface[part] = len(orders)
                orders[len(orders)] = order
        if unexplained > 0:
            raise self._other_code()
        if not orders:
            raise self._unnumbered(start)
        return orders, surface

    def _unnumbered(self, start: Start) -> RefusedFrameError:
        """Why no surface has a number: enough fringes with another code, or too few."""
        sizes = np.bincount(start.surface[start.surface >= 0])
        largest = start.phase[start.surface == sizes.argmax()]
        if self.pattern.code == 'contrast' and np.ptp(largest) > WORD * math.tau:
            return self._other_code()
        return NoStripeError(_UNNUMBERED[self.pattern.code])

    def _other_code(self) -> OtherPatternError:
        return OtherPatternError(
            'the code of the fringes is of another pattern than one of '
            f'{described(self.pattern)}: {ADVICE}'
        )

    def _code(self, light: Light, start: Start):
        """Amplitude of the coded light over the other's, and its weight (eq. 7)."""
        if self.pattern.code == 'contrast':
            return start.amplitude / np.maximum(start.level, 1), np.square(start.amplitude)
        red = np.maximum(start.own.swing, 1)
        other = LocalFit.of_mixture(start.colours[1:], light.shares[1:])
        variance = (other.rest + start.own.rest + 0.1) / self.grid.bins_in_window
        return other.swing / red, np.square(red) / variance

    def _absolute(self, start: Start, orders: dict[int, int], numbered: NDArray[np.int32]):
        """Absolute phase of bins, that of smooth surfaces, and the nodes' surface, -1 for none.

        What is beyond a surface is far from its quadric by as much as the nearest of it.
        """
        known = numbered >= 0
        nearest = Nearest(known)
        label = nearest(numbered)
        phase = start.phase + math.tau * np.array(list(orders.values()), np.float32)[label]
        inverse, _ = self._nodes.meet(phase)
        reference, away = np.empty(self.grid.shape, np.float32), np.empty_like(phase)
        for number in orders:
            mine = (numbered == number) & np.isfinite(inverse)
            quadric = quadric_through(self.grid.node_places, inverse, mine)
            here = label == number
            away[here] = (phase - self._nodes.phase(quadric.at(*self.grid.node_places)))[here]
            here = self.grid.repeated(here)
            reference[here] = self._bins.phase(quadric.at(*self.grid.bin_places))[here]
        share = np.maximum(self.grid.smooth_nodes(known.astype(np.float32), _SMOOTH), 1e-3)
        smooth = self.grid.smooth_nodes(away * known, _SMOOTH) / share
        away = np.where(np.abs(smooth - away) < _OFF, smooth, away)
        # A surface without a number is whole fringes off its neighbour's, or none.
        beside = nearest(away)
        away = np.where(start.surface >= 0, beside + wrap(away - beside), beside)
        along_u, along_v = self.grid.fringe
        reach = (math.ceil(_BEYOND * n) for n in (along_v, along_u / self.grid.node))
        near = dilated(known, *reach)
        other = wider_than_windows((start.surface >= 0) & ~known)
        near &= Nearest(known | other)(known)
        surface = np.where(near, label, -1)
        return reference + self.grid.at_bins(away), reference, surface

    def _lit(self, at_nodes) -> NDArray[np.bool_]:
        """Bins that the panel lights, but for its blurred rim."""
        _, v_p = self._nodes.meet(at_nodes)
        within = within_panel(self.rig, self.pattern, at_nodes, v_p)
        lit: NDArray[np.bool_] = self.grid.at_bins(within.astype(np.float32)) > RIM
        return lit

    def _filled(self, light: Light, start: Start, phase, outside) -> NDArray[np.float32]:
        """Grey light, whose stripe is filled from red by their ratio around it."""
        if self.pattern.code == 'contrast':
            return light.grey
        nearest = Nearest(outside)
        other = LocalFit.of_mixture(start.colours[1:], light.shares[1:])
        ratio = other.swing / np.maximum(start.own.swing, 1)
        offset = nearest(other.level - ratio * start.own.level)
        filled = self.grid.at_bins(offset)
        filled += (light.shares[0] + self.grid.at_bins(nearest(ratio))) * light.unbroken
        return np.where(np.abs(phase) < _STRIPE, filled, light.grey)

    def _blurred(self, light, usable, phase, inside) -> Waveform:
        """The waveform in the blur that a strip of the picture shows, where most fringes are."""
        high = min(len(inside), math.ceil(_STRIP * self.grid.fringe[1]))
        count = np.convolve(inside.sum(axis=1), np.ones(high), mode='valid')
        rows = slice(int(count.argmax()), int(count.argmax()) + high)
        strip = replace(self.grid, height=high * self.grid.rows)
        light, usable, phase, inside = (each[rows] for each in (light, usable, phase, inside))

        def left(waveform: Waveform) -> float:
            fit = Windows(strip, *waveform.at(phase), usable).fit(light)
            return float(np.median(fit.rest[inside]))

        return self._waveform.with_least(left)
