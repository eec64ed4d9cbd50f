"""The paper's noise for a method that has no phase map (section 3)."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.evaluation.scenes import PATTERN, Scene
from ftp_dent_ros.profilometry.carrier import ReferencePlane, measured_carrier
from ftp_dent_ros.profilometry.fourier_transform import FourierTransform
from ftp_dent_ros.profilometry.fourier_transform.demodulation import demodulate
from ftp_dent_ros.profilometry.fourier_transform.reference import reference_phase
from ftp_dent_ros.profilometry.fourier_transform.region import Window, lit_region


class NoisyPhase(FourierTransform):
    """A method of the paper's with noise added to its phase map before it is unwrapped.

    Attributes
    ----------
    noise : ndarray, shape (rows, columns), optional
        Radians, at the camera's pixels.
    """

    noise: NDArray[np.float32] | None = None

    def _phase_map(self, fringes: NDArray[np.complex64], window: Window) -> NDArray[np.complex64]:
        if self.noise is None:
            return fringes
        noise = window.padded(self.noise[:: self.settings.stride])
        return fringes * np.exp(1j * noise).astype(np.complex64)


def on_phase_map(
    image: NDArray[np.uint8], scene: Scene, noise: NDArray[np.float32]
) -> NDArray[np.uint8]:
    """Photograph whose phase map is that of `image` with noise added.

    The fringes of the photograph are demodulated as the paper does it; the noise turns their
    phase, and the photograph gets the turned fringes in place of its own.

    Parameters
    ----------
    image : ndarray, shape (rows, columns, 3), uint8
    scene : Scene
    noise : ndarray, shape (rows, columns)
        Radians.

    Returns
    -------
    ndarray, shape (rows, columns, 3), uint8
    """
    levels = image.astype(np.float32)
    red = np.ascontiguousarray(levels[..., 0])
    carrier = measured_carrier(red, scene.rig, PATTERN)
    inside = lit_region(red, carrier)
    rays = scene.rig.camera.rays(scene.rig.camera.pixel_grid())
    plane = ReferencePlane(float(scene.panel.pose.translation[2]))
    reference = reference_phase(scene.rig, PATTERN, rays, plane)
    fringes, _ = demodulate(red, inside, reference, carrier)
    change = np.where(inside, (fringes * np.expm1(1j * noise)).real, 0)
    # A channel has the fringes in proportion to its light: none in the stripe's green and blue.
    width = 2 * math.ceil(carrier.period / 2) + 1
    share = cv2.blur(levels, (width, 1)) / np.maximum(cv2.blur(red, (width, 1)), 1)[..., None]
    return np.clip(np.rint(levels + share * change[..., None]), 0, 255).astype(np.uint8)
