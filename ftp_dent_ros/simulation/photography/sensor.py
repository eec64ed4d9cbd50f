"""The camera's sensor: from the light on its pixels to a photograph."""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import ive, ndtri

from ftp_dent_ros.photograph.photograph import Encoding, Photograph
from ftp_dent_ros.simulation.photography.photometry import Photometry

# float32, for which OpenCV's annotations are too wide.
Image = NDArray[Any]

# Normal deviates by their rank: three times quicker than drawing them from a generator.
_NORMAL = ndtri((np.arange(65536) + 0.5) / 65536).astype(np.float32)


def blur(image: Image, sigma: float) -> Image:
    """Blur an image of camera pixels by `sigma` pixels, also where sigma is well below one.

    The kernel is the discrete Gaussian ``exp(-t) I_n(t)``, t = sigma^2 (Lindeberg, PAMI 1990):
    a sampled Gaussian of 0.4 pixels would have half the variance it should have.
    """
    if sigma == 0:
        return image
    reach = math.ceil(4 * sigma)
    kernel = ive(np.arange(-reach, reach + 1), sigma * sigma)
    kernel /= kernel.sum()
    return cv2.sepFilter2D(image, -1, kernel, kernel, borderType=cv2.BORDER_REPLICATE)


def speckle(shape: tuple[int, ...], photometry: Photometry, rng: np.random.Generator) -> Image:
    """Factor of mean 1 on a laser's light, shape (3, height, width), correlated in each colour.

    The log-normal of small contrast is close to the gamma distribution of averaged speckle.
    """
    white = rng.standard_normal(shape, np.float32)
    grains = np.stack([blur(channel, photometry.speckle_size_px) for channel in white])
    grains /= grains.std()
    sigma2 = math.log1p(photometry.speckle_contrast**2)
    return np.exp(math.sqrt(sigma2) * grains - sigma2 / 2)


def read_out(signal: Image, photometry: Photometry, rng: np.random.Generator) -> Photograph:
    """Turn the light on the pixels into levels, colour by colour.

    Parameters
    ----------
    signal : ndarray, shape (3, height, width), float32
        Red, green and blue; 1 saturates.
    photometry : Photometry
    rng : numpy.random.Generator

    Returns
    -------
    Photograph
        Of the encoding of `photometry`.
    """
    encoding = Encoding.named(photometry.encoding)
    white = (1 << encoding.bits) - 1
    if photometry.crosstalk:
        signal = _mixed(signal, photometry.crosstalk)
    if not encoding.coloured and not encoding.mosaic:
        image = _digitised(signal.mean(axis=0), photometry, rng, white)
        if photometry.jpeg_quality:
            image = _through_jpeg(image, photometry.jpeg_quality)
        return Photograph(image, white)
    image = np.stack([_digitised(channel, photometry, rng, white) for channel in signal], axis=-1)
    if encoding.mosaic:
        return Photograph(_behind_filters(image, encoding.mosaic), white, encoding.mosaic)
    if photometry.bayer:
        image = Photograph(_behind_filters(image, 'rggb'), white, 'rggb').rgb()
    if photometry.jpeg_quality:
        image = _through_jpeg(image, photometry.jpeg_quality)
    return Photograph(image, white)


def expose(signal: Image, photometry: Photometry, rng: np.random.Generator) -> NDArray[np.uint8]:
    """RGB of 8 bits, shape (height, width, 3), of what `read_out` gives."""
    return read_out(signal, photometry, rng).shown()


def _mixed(signal: Image, crosstalk: float) -> Image:
    """Light that the colours of the sensor see when each sees a part of the others."""
    others = signal.sum(axis=0) - signal
    return (signal + np.float32(crosstalk) * others) * np.float32(1 / (1 + 2 * crosstalk))


def _digitised(
    signal: Image, photometry: Photometry, rng: np.random.Generator, white: int
) -> NDArray[Any]:
    """Levels of one colour, shape (height, width), up to `white`."""
    level = 255 * blur(signal, photometry.psf_px)
    deviation = level * np.float32(255 / photometry.full_well)
    deviation += np.float32(photometry.read_noise**2)
    np.sqrt(deviation, out=deviation)
    deviation *= _NORMAL[rng.integers(0, len(_NORMAL), level.shape, np.uint16)]
    level += deviation
    np.clip(level, 0, 255, out=level)
    if photometry.camera_gamma != 1:
        level = 255 * (level / 255) ** (1 / photometry.camera_gamma)
    if white != 255:
        level *= np.float32(white / 255)
    return np.rint(level, out=level).astype(np.uint8 if white == 255 else np.uint16)


def _behind_filters(image: NDArray[Any], mosaic: str) -> NDArray[Any]:
    """One colour of each pixel of RGB."""
    raw = np.empty_like(image[..., 0])
    for index, colour in enumerate(mosaic):
        row, column = divmod(index, 2)
        raw[row::2, column::2] = image[row::2, column::2, 'rgb'.index(colour)]
    return raw


def _through_jpeg(image: NDArray, quality: int) -> NDArray[np.uint8]:
    bgr = np.ascontiguousarray(image[..., ::-1]) if image.ndim == 3 else image
    _, data = cv2.imencode('.jpg', bgr, [cv2.IMWRITE_JPEG_QUALITY, quality])
    decoded = np.asarray(cv2.imdecode(data, cv2.IMREAD_UNCHANGED))
    return np.ascontiguousarray(decoded[..., ::-1]) if image.ndim == 3 else decoded
