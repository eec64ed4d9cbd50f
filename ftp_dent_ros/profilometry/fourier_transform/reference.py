"""The virtual reference: the fringes as a plane z = l_c would show them (eq. 5 of the paper)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.profilometry.fourier_transform.carrier import Carrier, ReferencePlane
from ftp_dent_ros.profilometry.fourier_transform.fourier import analytic_signal, phase_of, spectrum
from ftp_dent_ros.rig.rig import Rig

# Rays nearly along a turned plane: it is taken to be no more than ten times as far there.
_FARTHEST = 0.1


def reference_phase(
    rig: Rig, pattern: Pattern, rays: NDArray[np.floating], plane: ReferencePlane
) -> NDArray[np.float32]:
    """Phase Phi_0 of the pattern on a plane, where the camera's rays meet it (eq. 5).

    The lens distortion of both is in it: the rays' by themselves, the projector's in its
    projection. The pattern is a formula and goes on beyond the projector's panel, as it must:
    an object in front of the plane is still lit where the plane is not.

    Parameters
    ----------
    rig : Rig
    pattern : Pattern
    rays : ndarray, shape (..., 3)
        Undistorted rays of the camera, z = 1.
    plane : ReferencePlane

    Returns
    -------
    ndarray, shape (...), float32
        Radians, absolute.
    """
    rays = np.asarray(rays, float)
    # Rays that leave the plane behind meet it far away: it only has to go on.
    depth = plane.depth / np.maximum(1 - plane.slope * rays[..., :1], _FARTHEST)
    columns = rig.projector.project(rig.to_projector(rays * depth))[..., 0]
    return pattern.phase(columns).astype(np.float32)


def extend(phase: NDArray[np.float32], before: int, after: int) -> NDArray[np.float32]:
    """Continue the rows of a phase by so many columns, at the frequency of their ends."""
    left = phase[:, :1] + np.arange(-before, 0) * (phase[:, 1:2] - phase[:, :1])
    right = phase[:, -1:] + np.arange(1, after + 1) * (phase[:, -1:] - phase[:, -2:-1])
    return np.concatenate([left, phase, right], axis=1).astype(np.float32)


def phase_shift(
    fringes: NDArray[np.complex64], reference: NDArray[np.float32], carrier: Carrier
) -> NDArray[np.float32]:
    """Wrapped phase shift of an analytic signal against the virtual reference image (eq. 12).

    The reference's image goes through the same filter as the object's, so that what the filter
    does to both cancels.

    Parameters
    ----------
    fringes : ndarray, shape (rows, columns), complex64
        Analytic signal of the object.
    reference : ndarray, shape (rows, columns), float32
        Phase Phi_0 of the virtual reference, radians.
    carrier : Carrier

    Returns
    -------
    ndarray, shape (rows, columns), float32
        Radians, within [-pi, pi].
    """
    image = (1 + np.cos(reference)) / 2  # eq. 6; the stripe is not needed in it
    transform = spectrum(image.astype(np.float32, copy=False))
    filtered = analytic_signal(transform, image.shape[1], carrier)
    return phase_of(fringes * np.conj(filtered))
