"""One photograph of the fringes to an organised cloud, by the method that is asked for."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Protocol

from numpy.typing import NDArray

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.cloud.coverage import DIM
from ftp_dent_ros.errors import ImageError, NoStripeError, PatternError, TooDarkError
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.photograph.photograph import Photograph
from ftp_dent_ros.profilometry.fourier_transform import FourierTransform
from ftp_dent_ros.profilometry.fringe_model import FringeModel
from ftp_dent_ros.profilometry.measurement import Measurement
from ftp_dent_ros.profilometry.settings import Settings
from ftp_dent_ros.profilometry.skin_image import SkinImager
from ftp_dent_ros.rig.geometry import moves_fringes
from ftp_dent_ros.rig.rig import Rig

_GREY = (
    'the image is grey, and the stripe that numbers the fringes is red: project a pattern '
    'of code contrast, photograph in colour, or, if these are raw pixels, tell their mosaic '
    '(--encoding, files.encoding, bayer_...)'
)


class Method(Protocol):
    """A method, made for one rig, pattern and settings."""

    def measure(self, photograph: Photograph) -> Measurement:
        """Measure the surface in a photograph of the camera's size."""


def method_for(rig: Rig, pattern: Pattern, settings: Settings) -> Method:
    """Method of the settings, with its tables."""
    if settings.method == 'least-squares':
        return FringeModel(rig, pattern, settings.stride)
    if pattern.code != 'stripe':
        raise PatternError(
            f'the method {settings.method} numbers fringes by a red stripe, and the pattern has '
            f'the code {pattern.code}: choose least-squares, or project a pattern with a stripe'
        )
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
        The pattern does not fit the projector, its fringes run along the baseline, or the method
        cannot number them.
    """

    def __init__(self, rig: Rig, pattern: Pattern, settings: Settings | None = None) -> None:
        pattern.check_fits(rig.projector)
        _check_axis(rig, pattern)
        self.rig, self.pattern, self.settings = rig, pattern, settings or Settings()
        # The methods know upright fringes: level ones are upright for a rig on its side.
        self._on_side = pattern.axis == 'v'
        if self._on_side:
            rig, pattern = rig.transposed, pattern.transposed
        self._upright = rig, pattern
        self._method = method_for(rig, pattern, self.settings)

    def reconstruct(self, image: Photograph | NDArray[Any]) -> Cloud:
        """Cloud of a photograph: that of `measure`."""
        return self.measure(image).cloud

    def measure(self, image: Photograph | NDArray[Any], skin: bool = False) -> Measurement:
        """Measure the surface in a photograph.

        Parameters
        ----------
        image : Photograph or ndarray
            As large as the camera's calibration says. An array is RGB, shape (height, width, 3),
            or grey, shape (height, width), of 8 or 16 bits (uint8, uint16).
        skin : bool
            Whether the cloud gets the image of its skin, too.

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
        photograph = Photograph.of(image)
        self._check(photograph)
        light = photograph
        if self.rig.response is not None:
            light = photograph.linear(self.rig.response)
        try:
            if self._on_side:
                measured = self._measured(light.transposed, skin).transposed
            else:
                measured = self._measured(light, skin)
            coverage = replace(measured.coverage, brightest=photograph.brightest)
            return replace(measured, coverage=coverage)
        except NoStripeError:
            if self.pattern.code == 'stripe' and photograph.is_grey:
                raise NoStripeError(_GREY) from None
            raise
        except TooDarkError as reason:
            if photograph.bits == 16 and photograph.brightest < DIM:
                raise TooDarkError(
                    f'{reason}; or, as no level is above {photograph.brightest:.1%} of 16 bits, '
                    'tell how many bits the camera has (bits, --encoding)'
                ) from None
            raise

    def _measured(self, photograph: Photograph, skin: bool) -> Measurement:
        """Measurement of a photograph whose fringes are upright."""
        measured = self._method.measure(photograph)
        if not skin:
            return measured
        imager = SkinImager.of(*self._upright, self.settings.stride)
        cloud = measured.cloud
        image = imager.image(photograph, cloud, measured.waveform)
        return replace(measured, cloud=replace(cloud, skin=image))

    def _check(self, photograph: Photograph) -> None:
        """Raise `ImageError` unless the photograph is of the camera's kind and size."""
        camera = self.rig.camera
        if (photograph.width, photograph.height) != (camera.width, camera.height):
            raise ImageError(
                f"the image is {photograph.width}x{photograph.height}, the rig's camera "
                f'{camera.width}x{camera.height}: use the camera that was calibrated, at that '
                'resolution'
            )
        stripe = self.pattern.code == 'stripe'
        if stripe and photograph.is_flat and not photograph.mosaic:
            raise ImageError(_GREY)


def _check_axis(rig: Rig, pattern: Pattern) -> None:
    """Raise `PatternError` if the depth does not move the pattern's fringes."""
    if moves_fringes(rig, pattern.axis):
        return
    way, place, other = {
        'u': ('upright', 'above or below', 'v'),
        'v': ('level', 'beside', 'u'),
    }[pattern.axis]
    raise PatternError(
        f'the pattern has {way} fringes, but the projector is {place} the camera, where the depth '
        f'hardly moves them: use a pattern with the axis {other}'
    )
