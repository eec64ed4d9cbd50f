"""Lenses, sensors and codecs for `outside_renderer`: from light to bytes."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.float32]
Generator = np.random.Generator
Step = Callable[[Image, Generator], Image]

# Electrons at saturation, and read noise in grey levels, of a small machine vision camera.
_WELL, _READ = 12000.0, 0.8
_PSF = 0.4


def develop(
    light: Image,
    rng: Generator,
    lens: Step | None = None,
    curve: Step | None = None,
    codec: Step | None = None,
    psf: float = _PSF,
) -> NDArray[np.uint8]:
    """Picture of 8 bits: lens, blur, shot and read noise, saturation, curve, rounding, codec."""
    light = lens(light, rng) if lens else light
    light = cv2.GaussianBlur(light, (0, 0), psf) if psf else light
    electrons = rng.poisson(np.clip(light, 0, 20).astype(float) * _WELL)
    signal = electrons / _WELL + rng.normal(0, _READ / 255, light.shape)
    signal = np.clip(signal, 0, 1).astype(np.float32)
    signal = curve(signal, rng) if curve else signal
    picture = np.rint(255 * np.clip(signal, 0, 1)).astype(np.uint8)
    return np.asarray(codec(picture, rng)) if codec else picture


def blobs(shape: tuple[int, ...], rng: Generator, count: int, sizes: tuple[float, float]) -> Image:
    """Round spots of 0 to 1, out of focus: pixels from and to, of their radius."""
    rows, columns = np.mgrid[: shape[0], : shape[1]].astype(np.float32)
    spots = np.zeros(shape[:2], np.float32)
    for _ in range(count):
        row, column = rng.uniform(0, shape[0]), rng.uniform(0, shape[1])
        radius = rng.uniform(*sizes)
        inside = radius - np.hypot(rows - row, columns - column)
        spots = np.maximum(spots, np.clip(inside / (0.4 * radius), 0, 1))
    return spots


def dirt_on_glass(light: Image, rng: Generator) -> Image:
    """Spots on the front glass: they dim what is behind, and scatter light of all around."""
    spots = 0.6 * blobs(light.shape, rng, 14, (12, 45))[..., None]
    return light * (1 - spots) + spots * cv2.GaussianBlur(light, (0, 0), 60)


def drops_on_glass(light: Image, rng: Generator) -> Image:
    """Rain on the front glass: each drop, out of focus, bends by some pixels what is behind."""
    rows, columns = np.mgrid[: light.shape[0], : light.shape[1]].astype(np.float32)
    du, dv = np.zeros_like(rows), np.zeros_like(rows)
    for _ in range(9):
        row, column = rng.uniform(0, light.shape[0]), rng.uniform(0, light.shape[1])
        radius, strength = rng.uniform(25, 60), rng.uniform(0.5, 5)
        x, y = (columns - column) / radius, (rows - row) / radius
        # The deflection of a thin lens, apodised as the aperture sees a part of it.
        weight = strength * np.exp(-(x * x + y * y))
        du, dv = du + weight * x, dv + weight * y
    return cv2.remap(
        light, columns + du, rows + dv, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT
    )


def vignette(light: Image, rng: Generator) -> Image:
    """A lens that gives its corners a quarter of the light."""
    height, width = light.shape[:2]
    rows, columns = np.mgrid[:height, :width].astype(np.float32)
    square = (columns / width - 0.5) ** 2 + (rows / height - 0.5) ** 2
    return light / (1 + 2 * square)[..., None] ** 4


def tilted_focus(light: Image, rng: Generator) -> Image:
    """Sharp at the left, a blur of 3.5 pixels at the right."""
    sigmas = np.linspace(0.4, 3.5, 12)
    width = light.shape[1]
    layers = [cv2.GaussianBlur(light, (0, 0), s) for s in sigmas]
    place = np.linspace(0, len(sigmas) - 1.001, width)
    first = place.astype(int)
    part = (place - first).astype(np.float32)[None, :, None]
    every = np.arange(width)
    stack = np.stack(layers)
    near, far = (np.moveaxis(stack[i, :, every], 0, 1) for i in (first, first + 1))
    return ((1 - part) * near + part * far).astype(np.float32)


def flare(light: Image, rng: Generator) -> Image:
    """The sun beside the frame: a veil that falls off across it, and ghosts of the stop."""
    height, width = light.shape[:2]
    rows, columns = np.mgrid[:height, :width].astype(np.float32)
    far = np.hypot(rows + 0.2 * height, columns - 1.1 * width) / width
    ghosts = 0.12 * blobs(light.shape, rng, 4, (30, 70))
    return light + (0.35 * np.exp(-1.5 * far) + ghosts)[..., None]


def s_curve(signal: Image, rng: Generator) -> Image:
    """sRGB with contrast on top, as pictures for people have."""
    grey = np.where(signal < 0.0031308, 12.92 * signal, 1.055 * signal ** (1 / 2.4) - 0.055)
    return (0.4 * grey + 0.6 * grey * grey * (3 - 2 * grey)).astype(np.float32)


def bad_lines(picture: NDArray, rng: Generator) -> NDArray:
    """Dead and hot pixels, two dead columns, a hot row, a row that repeats the one before."""
    height, width = picture.shape[:2]
    out = picture.copy()
    for level in (0, 255):
        rows, columns = rng.integers(0, height, 300), rng.integers(0, width, 300)
        out[rows, columns] = level
    out[:, rng.integers(0, width, 2)] = 0
    out[rng.integers(0, height)] = 255
    row = rng.integers(1, height)
    out[row] = out[row - 1]
    return out


def video(picture: NDArray, rng: Generator) -> NDArray:
    """A frame of a video: colour of a quarter of the pixels, blocks of 8 coarsely quantised."""
    height, width = picture.shape[:2]
    luma, *chroma = cv2.split(cv2.cvtColor(picture, cv2.COLOR_RGB2YCrCb))
    small = [
        cv2.resize(c, (width // 2, height // 2), interpolation=cv2.INTER_AREA) for c in chroma
    ]
    coded = [
        _blocks(plane, step) for plane, step in zip((luma, *small), (22, 34, 34), strict=True)
    ]
    chroma = [cv2.resize(c, (width, height), interpolation=cv2.INTER_LINEAR) for c in coded[1:]]
    return cv2.cvtColor(cv2.merge([coded[0], *chroma]), cv2.COLOR_YCrCb2RGB)


def _blocks(plane: NDArray, step: float) -> NDArray[np.uint8]:
    """Cosine transform of blocks of 8, rounded to a step."""
    height, width = (-(-n // 8) * 8 for n in plane.shape)
    padded = np.pad(
        plane.astype(np.float32),
        ((0, height - plane.shape[0]), (0, width - plane.shape[1])),
        mode='edge',
    )
    for row in range(0, height, 8):
        for column in range(0, width, 8):
            block = cv2.dct(padded[row : row + 8, column : column + 8])
            padded[row : row + 8, column : column + 8] = cv2.idct(np.rint(block / step) * step)
    return np.clip(np.rint(padded[: plane.shape[0], : plane.shape[1]]), 0, 255).astype(np.uint8)


def smear(pixels: int, upright: bool) -> Step:
    """The whole picture moves by so many pixels in the exposure."""

    def step(light: Image, rng: Generator) -> Image:
        size = (1, pixels) if upright else (pixels, 1)
        return cv2.blur(light, size)

    return step


def fog(share: float, back: float) -> Step:
    """Haze: what comes through, blurred in part, and the projector's light scattered back."""

    def step(light: Image, rng: Generator) -> Image:
        width = light.shape[1]
        near_projector = np.linspace(0.6, 1.4, width, dtype=np.float32)[None, :, None]
        wide = cv2.GaussianBlur(light, (0, 0), 12)
        return (1 - share) * light + 0.4 * share * wide + back * near_projector

    return step


def denoised(picture: NDArray, rng: Generator) -> NDArray:
    """What a camera for people makes of a picture: noise filtered away, then edges sharpened."""
    smooth = cv2.bilateralFilter(picture, 5, 12, 1.5).astype(np.float32)
    sharp = smooth + 0.8 * (smooth - cv2.GaussianBlur(smooth, (0, 0), 1.2))
    return np.clip(np.rint(sharp), 0, 255).astype(np.uint8)


def enlarged(picture: NDArray, rng: Generator) -> NDArray:
    """A picture of 70 % of the pixels, enlarged by the driver."""
    height, width = picture.shape[:2]
    small = cv2.resize(picture, None, fx=0.7, fy=0.7, interpolation=cv2.INTER_AREA)
    return cv2.resize(small, (width, height), interpolation=cv2.INTER_CUBIC)


def tone_mapped(picture: NDArray, rng: Generator) -> NDArray:
    """A phone's local contrast: levels stretched by what is around them."""
    luma, *chroma = cv2.split(cv2.cvtColor(picture, cv2.COLOR_RGB2YCrCb))
    stretched = cv2.createCLAHE(clipLimit=1.5, tileGridSize=(6, 4)).apply(luma)
    return cv2.cvtColor(cv2.merge([stretched, *chroma]), cv2.COLOR_YCrCb2RGB)


def fixed_pattern(signal: Image, rng: Generator) -> Image:
    """Columns with gains of their own by 1.5 %, rows with offsets of 1.5 levels."""
    columns = 1 + 0.015 * rng.standard_normal((1, signal.shape[1], 1))
    rows = 1.5 / 255 * rng.standard_normal((signal.shape[0], 1, 1))
    return (signal * columns + rows).astype(np.float32)


def gain_jump(signal: Image, rng: Generator) -> Image:
    """The automatic exposure changes its gain while rows are read: by a half from one on."""
    row = int(rng.uniform(0.3, 0.7) * signal.shape[0])
    return np.concatenate([0.6 * signal[:row], 0.9 * signal[row:]])


def strap(light: Image, rng: Generator) -> Image:
    """A strap before a part of the lens, far out of focus: it hides, and glows a little."""
    height, width = light.shape[:2]
    rows, columns = np.mgrid[:height, :width].astype(np.float32)
    slope, at = rng.uniform(-0.3, 0.3), rng.uniform(0.25, 0.4) * width
    share = 1 / (1 + np.exp(-(at - columns - slope * (rows - height / 2)) / 18))[..., None]
    return light * (1 - share) + 0.02 * share


def snowflakes(light: Image, rng: Generator) -> Image:
    """Snow between drone and skin in the projector's light: bright streaks and soft discs."""
    height, width = light.shape[:2]
    discs = 0.5 * blobs(light.shape, rng, 25, (3, 14))
    streaks = np.zeros((height, width), np.float32)
    for _ in range(40):
        start = rng.uniform(0, (width, height))
        stop = start + rng.uniform(5, 25) * np.array([0.3, 1.0])
        cv2.line(streaks, *(tuple(int(a) for a in p) for p in (start, stop)), 1.0, 2)
    streaks = 0.35 * cv2.GaussianBlur(streaks, (0, 0), 1.2)
    return light + (discs * rng.uniform(0.3, 1) + streaks)[..., None] * 0.6


def turned(picture: NDArray, rng: Generator) -> NDArray:
    """A camera mounted head over, whose driver does not know it."""
    return np.ascontiguousarray(picture[::-1, ::-1])


def mirrored(picture: NDArray, rng: Generator) -> NDArray:
    """A driver that mirrors, as for people who look at themselves."""
    return np.ascontiguousarray(picture[:, ::-1])
