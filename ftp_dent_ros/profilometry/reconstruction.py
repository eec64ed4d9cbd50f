"""One photograph of the fringes to an organised cloud: the algorithm, one line a step."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.cloud import Cloud
from ftp_dent_ros.errors import ImageError, NoStripeError
from ftp_dent_ros.pattern import Pattern
from ftp_dent_ros.profilometry.absolute_phase import fringe_order
from ftp_dent_ros.profilometry.carrier import (
    Carrier,
    ReferencePlane,
    carrier_on,
    measured_carrier,
    plane_through,
)
from ftp_dent_ros.profilometry.extrapolation import demodulate
from ftp_dent_ros.profilometry.fourier import phase_of
from ftp_dent_ros.profilometry.least_squares import LeastSquares, Quality
from ftp_dent_ros.profilometry.reference import extend, phase_shift, reference_phase
from ftp_dent_ros.profilometry.region import Window, clipped, lit_region, trusted
from ftp_dent_ros.profilometry.settings import Settings
from ftp_dent_ros.profilometry.stripe import Stripe, find_stripe
from ftp_dent_ros.profilometry.triangulation import triangulate
from ftp_dent_ros.profilometry.unwrapping import unwrap
from ftp_dent_ros.rig import Rig

# Of the rows beyond the region, in periods.
_MARGIN = 4.0
# The reference planes' depths are whole powers of this, so that one table serves many frames.
_DEPTH_STEP = 1.02
# Width of the blurred rim of the projector's panel, pixels.
_RIM = 1.5
# Between rows, radians: a quarter of a fringe.
_JUMP = math.pi / 2


@dataclass(frozen=True)
class Measurement:
    """What one photograph gave.

    Attributes
    ----------
    cloud : Cloud
    stripe_depth : float
        l_c, the depth of the red stripe and of the virtual reference, metres.
    quality : Quality or None
        Of each point; only ``'least-squares'`` knows it.
    """

    cloud: Cloud
    stripe_depth: float
    quality: Quality | None = None


class Reconstructor:
    """Reconstructs photographs of one rig and one pattern.

    Parameters
    ----------
    rig : Rig
    pattern : Pattern
    settings : Settings, optional

    Raises
    ------
    PatternError
        The pattern does not fit the projector.
    """

    def __init__(self, rig: Rig, pattern: Pattern, settings: Settings | None = None) -> None:
        pattern.check_fits(rig.projector)
        self.rig, self.pattern, self.settings = rig, pattern, settings or Settings()
        if self.settings.method == 'least-squares':
            self._least_squares = LeastSquares(
                rig, pattern, self.settings.stride, self.settings.fast
            )
            return
        rows = rig.camera.pixel_grid()[:: self.settings.stride]
        self._rays = rig.camera.rays(rows).astype(np.float32)
        self._reference_phase = lru_cache(maxsize=4)(self._reference_at)

    def reconstruct(self, image: NDArray[np.uint8]) -> Cloud:
        """Cloud of a photograph: that of `measure`."""
        return self.measure(image).cloud

    def measure(
        self, image: NDArray[np.uint8], phase_noise: NDArray[np.float32] | None = None
    ) -> Measurement:
        """Measure the surface in a photograph.

        Parameters
        ----------
        image : ndarray, shape (height, width, 3), uint8
            RGB, as large as the camera's calibration says.
        phase_noise : ndarray, shape (height, width), optional
            Added to the phase map before it is unwrapped, as the paper's simulation does
            (section 3); radians. Least squares have no such map.

        Returns
        -------
        Measurement
            Its cloud has every `stride`-th pixel, in the camera's optical frame; NaN where
            nothing is measured.

        Raises
        ------
        ImageError
            The image has the wrong type or size.
        TooDarkError, SaturatedError, NoStripeError
            The image gives no measurement; the message says why and what to do.
        """
        self._check(image)
        if self.settings.method == 'least-squares':
            return Measurement(*self._least_squares.measure(image))
        stride = self.settings.stride
        levels = image.astype(np.float32)
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
        if phase_noise is not None:
            fringes = fringes * np.exp(1j * window.padded(phase_noise[::stride]))
        valid = trusted(modulation, inside, explained, carrier)
        valid &= window.padded(usable[::stride])
        if self.settings.method == 'virtual-reference':
            wrapped, start = phase_shift(fringes, reference, carrier), reference
        else:
            wrapped, start = phase_of(fringes), np.float32(0)
        unwrapped = unwrap(wrapped, valid, self.settings.unwrapping, self.settings.tau, _JUMP)
        relative = start + unwrapped.phase
        turns = fringe_order(
            relative,
            unwrapped.part,
            np.rint(stripe.row / stride).astype(np.intp) - window.rows.start,
            stripe.column - window.columns.start + window.before,
        )
        u_p = self.pattern.column(window.bare(relative + turns)).astype(np.float32)
        cloud = self._cloud(window, u_p, window.bare(modulation))
        return Measurement(cloud, float(np.median(points[:, 2])))

    def _check(self, image: NDArray[np.uint8]) -> None:
        """Raise `ImageError` unless the image is of the camera's kind and size."""
        camera = self.rig.camera
        if not isinstance(image, np.ndarray) or image.dtype != np.uint8:
            kind = getattr(image, 'dtype', type(image).__name__)
            raise ImageError(f'the image is of {kind}, not 8-bit levels: give an 8-bit RGB image')
        if image.shape != (camera.height, camera.width, 3):
            size = 'x'.join(str(length) for length in image.shape[1::-1] + image.shape[2:])
            raise ImageError(
                f"the image is {size}, the rig's camera {camera.width}x{camera.height}x3: "
                'use the camera that was calibrated, at that resolution and in colour'
            )

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
