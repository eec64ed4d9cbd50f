"""One photograph of the fringes to an organised cloud, by the method that is asked for."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.cloud import Cloud
from ftp_dent_ros.errors import ImageError
from ftp_dent_ros.pattern import Pattern
from ftp_dent_ros.profilometry.fourier_transform import FourierTransform
from ftp_dent_ros.profilometry.least_squares import LeastSquares
from ftp_dent_ros.profilometry.measurement import Measurement
from ftp_dent_ros.profilometry.settings import Settings
from ftp_dent_ros.rig import Rig


class Method(Protocol):
    """A method, made for one rig, pattern and settings."""

    def measure(self, image: NDArray[np.uint8]) -> Measurement:
        """Measure the surface in a photograph, RGB, of the camera's size."""


def method_for(rig: Rig, pattern: Pattern, settings: Settings) -> Method:
    """Method of the settings, with its tables."""
    if settings.method == 'least-squares':
        return LeastSquares(rig, pattern, settings.stride, bool(settings.fast))
    return FourierTransform(rig, pattern, settings)


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
        self._method = method_for(rig, pattern, self.settings)

    def reconstruct(self, image: NDArray[np.uint8]) -> Cloud:
        """Cloud of a photograph: that of `measure`."""
        return self.measure(image).cloud

    def measure(self, image: NDArray[np.uint8]) -> Measurement:
        """Measure the surface in a photograph.

        Parameters
        ----------
        image : ndarray, shape (height, width, 3), uint8
            RGB, as large as the camera's calibration says.

        Returns
        -------
        Measurement
            Its cloud has every `stride`-th pixel, in the camera's optical frame; NaN where
            nothing is measured.

        Raises
        ------
        ImageError
            The image has the wrong type or size.
        RefusedFrameError
            The image gives no measurement; the message says why and what to do.
        """
        self._check(image)
        return self._method.measure(image)

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
