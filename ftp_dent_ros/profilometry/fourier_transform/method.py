"""The paper's algorithm (sections 2.2 to 2.5), one line a step."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache, partial

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.cloud.coverage import Coverage
from ftp_dent_ros.errors import NoStripeError
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.photograph.photograph import Photograph
from ftp_dent_ros.profilometry.checks.frame import check_frame
from ftp_dent_ros.profilometry.fourier_transform.absolute_phase import fringe_order
from ftp_dent_ros.profilometry.fourier_transform.carrier import (
    Carrier,
    ReferencePlane,
    carrier_on,
    measured_carrier,
    plane_through,
)
from ftp_dent_ros.profilometry.fourier_transform.demodulation import demodulate
from ftp_dent_ros.profilometry.fourier_transform.estrada import estrada
from ftp_dent_ros.profilometry.fourier_transform.fourier import phase_of
from ftp_dent_ros.profilometry.fourier_transform.reference import (
    extend,
    phase_shift,
    reference_phase,
)
from ftp_dent_ros.profilometry.fourier_transform.region import Window, clipped, lit_region, trusted
from ftp_dent_ros.profilometry.fourier_transform.stripe import Stripe, find_stripe
from ftp_dent_ros.profilometry.measurement import Measurement
from ftp_dent_ros.profilometry.settings import TAU, Settings
from ftp_dent_ros.profilometry.triangulation import triangulate
from ftp_dent_ros.profilometry.unwrapping import unwrap
from ftp_dent_ros.rig.rig import Rig

# Of the rows beyond the region, in periods.
_MARGIN = 4.0
# The reference planes' depths are whole powers of this, so that one table serves many frames.
_DEPTH_STEP = 1.02
# Width of the blurred rim of the projector's panel, pixels.
_RIM = 1.5
# Between rows, radians: a quarter of a fringe.
_JUMP = math.pi / 2


class FourierTransform:
    """The paper's two methods for one rig and pattern: direct, or against a virtual reference.

    Parameters
    ----------
    rig : Rig
    pattern : Pattern
    settings : Settings
        Of the method ``'direct'`` or ``'virtual-reference'``.
    """

    def __init__(self, rig: Rig, pattern: Pattern, settings: Settings) -> None:
        self.rig, self.pattern, self.settings = rig, pattern, settings
        rows = rig.camera.pixel_grid()[:: settings.stride]
        self._rays = rig.camera.rays(rows).astype(np.float32)
        self._reference_phase = lru_cache(maxsize=4)(self._reference_at)

    def measure(self, photograph: Photograph) -> Measurement:
        """Measure the surface in a photograph.

        Raises
        ------
        TooDarkError, SaturatedError, NoStripeError, OtherPatternError
        """
        stride = self.settings.stride
        levels = photograph.rgb() * np.float32(photograph.unit)
        red = np.ascontiguousarray(levels[..., 0])

        coarse = measured_carrier(red, self.rig, self.pattern)
        region = lit_region(red, coarse)
        usable = ~clipped(red, region, coarse)
        stripe = find_stripe(levels, region, coarse)
        points = self._points_of(stripe)
        plane = plane_through(self.rig, self.pattern, points, coarse)
        carrier = carrier_on(self.rig, self.pattern, plane)

        window = Window.around(region[::stride], math.ceil(_MARGIN * carrier.period))
        inside = window.padded(region[::stride])
        rows = window.padded(red[::stride])
        reference = extend(
            window.cut(self._reference(plane, carrier)), window.before, window.after
        )
        fringes, explained = demodulate(rows, inside, reference, carrier)
        modulation = np.abs(fringes)
        fringes = self._phase_map(fringes, window)
        valid = trusted(modulation, inside, explained, carrier)
        valid &= window.padded(usable[::stride])
        if self.settings.method == 'virtual-reference':
            wrapped, start = phase_shift(fringes, reference, carrier), reference
        else:
            wrapped, start = phase_of(fringes), np.float32(0)
        integrate = None
        if self.settings.unwrapping == 'estrada':
            integrate = partial(estrada, tau=self.settings.tau or TAU)
        unwrapped = unwrap(wrapped, valid, _JUMP, integrate)
        relative = start + unwrapped.phase
        turns = fringe_order(
            relative,
            unwrapped.part,
            np.rint(stripe.row / stride).astype(np.intp) - window.rows.start,
            stripe.column - window.columns.start + window.before,
        )
        phase = window.bare(relative + turns)
        confirmed = self._check_pattern(window, phase, window.bare(valid) & np.isfinite(phase))
        u_p = self.pattern.column(phase).astype(np.float32)
        cloud = self._cloud(window, u_p, window.bare(modulation))
        coverage = Coverage.of(
            region[::stride, ::stride], cloud.valid, clipped=~usable[::stride, ::stride]
        )
        coverage = replace(coverage, confirmed=confirmed)
        return Measurement(cloud, float(np.median(points[:, 2])), coverage)

    def _phase_map(self, fringes: NDArray[np.complex64], window: Window) -> NDArray[np.complex64]:
        """Fringes as they are unwrapped: where a simulation may turn their phase."""
        return fringes

    def _check_pattern(self, window: Window, phase: NDArray, valid: NDArray[np.bool_]) -> bool:
        """Raise if the fringes cannot be those of the given pattern; whether no other's."""
        shape = self._rays.shape[:2]
        whole, lit = np.zeros(shape, np.float32), np.zeros(shape, bool)
        whole[window.rows, window.columns], lit[window.rows, window.columns] = phase, valid
        return check_frame(self.pattern, whole, lit)

    def _points_of(self, stripe: Stripe) -> NDArray[np.floating]:
        """Points on the stripe, shape (points, 3), metres."""
        rays = self.rig.camera.rays(np.stack([stripe.column, stripe.row], axis=-1))[None]
        columns = np.full(rays.shape[:2], self.pattern.stripe_center_px, np.float32)
        depth, _ = triangulate(self.rig, rays.astype(np.float32), columns)
        met = np.isfinite(depth)
        if met.mean() < 0.5:
            raise NoStripeError(
                'the red stripe is seen where the projector cannot light it: check that rig.yaml '
                'and the pattern belong to this camera and projector'
            )
        return rays[met] * depth[met][:, None]

    def _reference(self, plane: ReferencePlane, carrier: Carrier) -> NDArray[np.float32]:
        """Phase of the fringes to compare with, at every `stride`-th row."""
        if self.settings.method == 'direct':
            ramp = 2 * np.pi * carrier.sign * carrier.frequency * np.arange(self.rig.camera.width)
            return np.broadcast_to(ramp.astype(np.float32), self._rays.shape[:2])
        return self._reference_phase(
            round(math.log(plane.depth) / math.log(_DEPTH_STEP)), plane.slope
        )

    def _reference_at(self, step: int, slope: float) -> NDArray[np.float32]:
        plane = ReferencePlane(_DEPTH_STEP**step, slope)
        return reference_phase(self.rig, self.pattern, self._rays, plane)

    def _cloud(
        self, window: Window, u_p: NDArray[np.float32], modulation: NDArray[np.float32]
    ) -> Cloud:
        """Triangulate the window's pixels on the grid, where the projector's panel reaches."""
        stride, projector = self.settings.stride, self.rig.projector
        first = -window.columns.start % stride
        columns = slice(window.columns.start + first, window.columns.stop, stride)
        rays, u_p = self._rays[window.rows, columns], u_p[:, first::stride]
        depth, v_p = triangulate(self.rig, rays, u_p)
        inset = _RIM - 0.5
        reached = (u_p > inset) & (u_p < projector.width - 1 - inset)
        reached &= (v_p > inset) & (v_p < projector.height - 1 - inset)
        depth[~reached] = np.nan

        shape = self._rays[:, ::stride].shape
        points = np.full(shape, np.nan, np.float32)
        intensity = np.zeros(shape[:2], np.float32)
        at = window.rows, slice(columns.start // stride, columns.start // stride + u_p.shape[1])
        np.multiply(rays, depth[..., None], out=points[at])
        intensity[at] = modulation[:, first::stride]
        return Cloud(points, intensity)
