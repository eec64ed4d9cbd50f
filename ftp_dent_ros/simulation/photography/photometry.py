"""Light and sensor: how bright, how noisy and how sharp a photograph is."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.photograph.photograph import Encoding


@dataclass(frozen=True)
class Photometry:
    """Projector's light, ambient light and the camera's sensor.

    Attributes
    ----------
    exposure : float
        Signal, as a fraction of saturation, of a white patch (albedo 1) that faces the projector
        at `reference_distance` in full light, at the camera's centre. Above 1 it saturates.
    reference_distance : float
        Metres.
    ambient : float
        Light from elsewhere on the skin, as a fraction of that of the white patch.
    shading : bool
        Inverse-square law, cosine law and vignetting; without it the light is even.
    defocus_px : float
        Standard deviation of the projector's blur, projector pixels.
    projector_black : float
        Light of a black projector pixel, as a fraction of a white one.
    projector_gamma : float
        Light is (grey level / 255) to this power.
    speckle_contrast : float
        Standard deviation of a laser's speckle over its mean, in camera pixels; 0 is a lamp.
    speckle_size_px : float
        Standard deviation of the blur that makes speckle correlated, camera pixels.
    phase_noise_px : float
        White noise on the projector column that a camera pixel sees, projector pixels: the
        noise on the phase that the paper's simulation adds, times T_p / (2 pi).
    psf_px : float
        Standard deviation of the camera lens's blur, camera pixels.
    full_well : float
        Electrons at saturation: shot noise.
    read_noise : float
        Standard deviation of the read noise, grey levels.
    crosstalk : float
        Part of each other colour's light that a colour of the sensor sees, white balanced.
    camera_gamma : float
        Grey level is 255 times the signal to 1 / camera_gamma; 1 is a linear camera.
    encoding : str
        What the camera gives of its sensor, as `Encoding.named` reads it: three colours at each
        pixel (``rgb8``), the colours of a mosaic as they are (``bayer_rggb12``), or the mean of
        the three colours (``mono12``).
    bayer : bool
        The sensor has an RGGB colour filter and its image, of three colours, is demosaiced.
    jpeg_quality : int
        1 to 100 for an image that came through JPEG, 0 for none.
    samples : int
        Points and instants at which the light on each pixel is evaluated, a power of two.

    Raises
    ------
    ConfigurationError
        A value is out of its range.
    """

    exposure: float = 250 / 255
    reference_distance: float = 0.8
    ambient: float = 0.02
    shading: bool = True
    defocus_px: float = 0.7
    projector_black: float = 0.01
    projector_gamma: float = 1.0
    speckle_contrast: float = 0.0
    speckle_size_px: float = 0.5
    phase_noise_px: float = 0.0
    psf_px: float = 0.4
    full_well: float = 12000.0
    read_noise: float = 0.8
    crosstalk: float = 0.0
    camera_gamma: float = 1.0
    encoding: str = 'rgb8'
    bayer: bool = False
    jpeg_quality: int = 0
    samples: int = 8

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if field.type == 'str':
                named = isinstance(value, str) and Encoding.is_name(value)
                _require(named, field.name, value, 'such as rgb8, mono12 or bayer_rggb12')
                continue
            if field.type == 'bool':
                _require(isinstance(value, bool), field.name, value, 'true or false')
                continue
            number = isinstance(value, (int, float)) and not isinstance(value, bool)
            if field.type == 'int':
                _require(isinstance(value, int) and number, field.name, value, 'a whole number')
            finite = number and math.isfinite(value) and value >= 0
            _require(finite, field.name, value, 'a number that is not negative')
        for name in (
            'exposure',
            'reference_distance',
            'projector_gamma',
            'full_well',
            'camera_gamma',
        ):
            _require(getattr(self, name) > 0, name, getattr(self, name), 'a positive number')
        _require(self.speckle_contrast <= 1, 'speckle_contrast', self.speckle_contrast, '0 to 1')
        _require(self.crosstalk <= 1, 'crosstalk', self.crosstalk, '0 to 1')
        _require(self.projector_black <= 1, 'projector_black', self.projector_black, '0 to 1')
        _require(self.jpeg_quality <= 100, 'jpeg_quality', self.jpeg_quality, '0 to 100')
        plain = self.encoding in ('rgb8', 'mono8') or not self.jpeg_quality
        _require(plain, 'jpeg_quality', self.jpeg_quality, '0 for what is neither rgb8 nor mono8')
        power = self.samples > 0 and self.samples & (self.samples - 1) == 0
        _require(power and self.samples <= 256, 'samples', self.samples, '1, 2, 4, ... 256')


def _require(condition: bool, name: str, value: object, expected: str) -> None:
    if not condition:
        raise ConfigurationError(f'photometry: {name} is {value!r}: give {expected}')
