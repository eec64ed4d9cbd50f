"""How bright, how noisy and how sharp a photograph is, and the sensor that takes it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import ive, ndtri

from ftp_dent_ros.fields import Checked, Limits, NotNegative, Positive, Share
from ftp_dent_ros.photograph.photograph import Encoding, Photograph

# float32, for which OpenCV's annotations are too wide.
Image = NDArray[Any]

# Normal deviates by their rank: three times quicker than drawing them from a generator.
_NORMAL = ndtri((np.arange(65536) + 0.5) / 65536).astype(np.float32)


@dataclass(frozen=True)
class Photometry(Checked):
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
    phase_noise_px : float
        White noise on the projector column that a camera pixel sees, projector pixels: the
        noise on the phase that the paper's simulation adds, times T_p / (2 pi).
    psf_px : float
        Standard deviation of the camera lens's blur, camera pixels.
    full_well : float
        Electrons at saturation: shot noise.
    read_noise : float
        Standard deviation of the read noise, grey levels.
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

    exposure: Positive = 250 / 255
    reference_distance: Positive = 0.8
    ambient: NotNegative = 0.02
    shading: bool = True
    defocus_px: NotNegative = 0.7
    projector_black: Share = 0.01
    projector_gamma: Positive = 1.0
    speckle_contrast: Share = 0.0
    phase_noise_px: NotNegative = 0.0
    psf_px: NotNegative = 0.4
    full_well: Positive = 12000.0
    read_noise: NotNegative = 0.8
    camera_gamma: Positive = 1.0
    encoding: str = 'rgb8'
    bayer: bool = False
    jpeg_quality: Annotated[int, Limits(0, 100)] = 0
    samples: Annotated[int, Limits(choices=tuple(2**power for power in range(9)))] = 8

    def __post_init__(self) -> None:
        super().__post_init__()
        if not Encoding.is_name(self.encoding):
            self.refuse('encoding', 'such as rgb8, mono12 or bayer_rggb12')
        if self.jpeg_quality and self.encoding not in ('rgb8', 'mono8'):
            self.refuse('jpeg_quality', '0 for what is neither rgb8 nor mono8')


def reach_of(sigma: float) -> int:
    """How far a blur of `sigma` pixels brings light, pixels."""
    return math.ceil(4 * sigma)


def blur(image: Image, sigma: float) -> Image:
    """Blur an image of camera pixels by `sigma` pixels, also where sigma is well below one.

    The kernel is the discrete Gaussian ``exp(-t) I_n(t)``, t = sigma^2 (Lindeberg, PAMI 1990):
    a sampled Gaussian of 0.4 pixels would have half the variance it should have.
    """
    if sigma == 0:
        return image
    reach = reach_of(sigma)
    kernel = ive(np.arange(-reach, reach + 1), sigma * sigma)
    kernel /= kernel.sum()
    return cv2.sepFilter2D(image, -1, kernel, kernel, borderType=cv2.BORDER_REPLICATE)


def speckle(shape: tuple[int, ...], photometry: Photometry, rng: np.random.Generator) -> Image:
    """Factor of mean 1 on a laser's light, shape (3, height, width), correlated in each colour.

    The log-normal of small contrast is close to the gamma distribution of averaged speckle.
    """
    white = rng.standard_normal(shape, np.float32)
    # Half a pixel's blur correlates neighbours, as a lens does.
    grains = np.stack([blur(channel, 0.5) for channel in white])
    grains /= grains.std()
    sigma2 = math.log1p(photometry.speckle_contrast**2)
    return np.exp(math.sqrt(sigma2) * grains - sigma2 / 2)


def read_out(
    signal: Image, photometry: Photometry, rng: np.random.Generator, beyond: int = 0
) -> Photograph:
    """Turn the light on the pixels into levels, colour by colour.

    Parameters
    ----------
    signal : ndarray, shape (3, rows, columns), float32
        Red, green and blue; 1 saturates.
    photometry : Photometry
    rng : numpy.random.Generator
    beyond : int
        Pixels by which the signal is larger than the image, for the lens brings them in.

    Returns
    -------
    Photograph
        Of the encoding of `photometry`.
    """
    encoding = Encoding.named(photometry.encoding)
    white = (1 << encoding.bits) - 1
    grey = not encoding.coloured and not encoding.mosaic
    light = signal.mean(axis=0)[None] if grey else signal
    levels = [_digitised(channel, photometry, rng, white, beyond) for channel in light]
    image = np.stack(levels, axis=-1)
    if encoding.mosaic:
        return Photograph(_behind_filters(image, encoding.mosaic), white, encoding.mosaic)
    if photometry.bayer and not grey:
        image = Photograph(_behind_filters(image, 'rggb'), white, 'rggb').rgb()
    if photometry.jpeg_quality:
        quality = [cv2.IMWRITE_JPEG_QUALITY, photometry.jpeg_quality]
        _, data = cv2.imencode('.jpg', np.ascontiguousarray(image[..., ::-1]), quality)
        decoded = np.asarray(cv2.imdecode(data, cv2.IMREAD_UNCHANGED)).reshape(image.shape)
        image = np.ascontiguousarray(decoded[..., ::-1])
    return Photograph(image[..., 0] if grey else image, white)


def _digitised(
    signal: Image, photometry: Photometry, rng: np.random.Generator, white: int, beyond: int
) -> NDArray[Any]:
    """Levels of one colour, shape (height, width), up to `white`."""
    rows, columns = (slice(beyond, n - beyond) for n in signal.shape)
    level = 255 * blur(signal, photometry.psf_px)[rows, columns]
    deviation = level * np.float32(255 / photometry.full_well)
    deviation += np.float32(photometry.read_noise**2)
    np.sqrt(deviation, out=deviation)
    deviation *= _NORMAL[rng.integers(0, len(_NORMAL), level.shape, np.uint16)]
    level += deviation
    np.clip(level, 0, 255, out=level)
    if photometry.camera_gamma != 1:
        level = 255 * (level / 255) ** (1 / photometry.camera_gamma)
    level *= np.float32(white / 255)
    return np.rint(level, out=level).astype(np.uint8 if white == 255 else np.uint16)


def _behind_filters(image: NDArray[Any], mosaic: str) -> NDArray[Any]:
    """One colour of each pixel of RGB."""
    raw = np.empty_like(image[..., 0])
    for index, colour in enumerate(mosaic):
        row, column = divmod(index, 2)
        raw[row::2, column::2] = image[row::2, column::2, 'rgb'.index(colour)]
    return raw
