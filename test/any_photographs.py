"""Photographs of anything: what a camera may hand over, measurable or not, seeded."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.uint8]
Maker = Callable[[np.random.Generator, Image], Image]

# What a photograph holds: no fringes at all, the true fringes in their places, or something.
NOTHING, TRUE, ANY = 'nothing', 'true', 'any'


@dataclass(frozen=True)
class AnyPhotograph:
    """A photograph, of which kind, and what it holds."""

    kind: str
    holds: str
    image: Image


def any_photograph(index: int, base: Image) -> AnyPhotograph:
    """The photograph of a number, made of a true one where it is made of one.

    Parameters
    ----------
    index : int
        Kinds take turns, so that any run of numbers has all of them.
    base : ndarray, shape (height, width, 3), uint8
        A true photograph.
    """
    kind, (holds, make) = list(KINDS.items())[index % len(KINDS)]
    image = make(np.random.default_rng(index), base)
    return AnyPhotograph(kind, holds, np.ascontiguousarray(image, np.uint8))


def _bytes(rng: np.random.Generator, base: Image) -> Image:
    return rng.integers(0, 256, base.shape, np.uint8)


def _normal(rng: np.random.Generator, base: Image) -> Image:
    level, spread = rng.uniform(0, 255), rng.uniform(1, 80)
    return _levels(rng.normal(level, spread, base.shape))


def _blurred_noise(rng: np.random.Generator, base: Image) -> Image:
    """Grains as wide as fringes are, or wider."""
    white = rng.standard_normal(base.shape).astype(np.float32)
    smooth = cv2.GaussianBlur(white, (0, 0), float(np.exp(rng.uniform(-0.5, 3.5))))
    return _levels(rng.uniform(60, 180) + rng.uniform(5, 80) * smooth / smooth.std())


def _dead(rng: np.random.Generator, base: Image) -> Image:
    """The sensor's own noise in the dark."""
    return _levels(rng.normal(rng.uniform(0, 8), rng.uniform(0.5, 3), base.shape))


def _reddened_noise(rng: np.random.Generator, base: Image) -> Image:
    """Noise with a red stripe painted in."""
    image = _blurred_noise(rng, base)
    width = base.shape[1]
    column = rng.integers(width // 10, width - width // 10)
    image[:, column : column + max(width // 60, 6), 1:] = 0
    return image


def _gradient(rng: np.random.Generator, base: Image) -> Image:
    y, x = np.mgrid[: base.shape[0], : base.shape[1]] / base.shape[1]
    ramps = [a * x + b * y + c * x * y for a, b, c in rng.normal(0, 150, (3, 3))]
    return _levels(np.stack(ramps, axis=-1) + rng.uniform(0, 255))


def _text(rng: np.random.Generator, base: Image) -> Image:
    height, width = base.shape[:2]
    image = np.full(base.shape, rng.integers(150, 256), np.uint8)
    colour = [int(c) for c in rng.integers(0, 120, 3)]
    letters = np.array(list('abcdefghijklmnop qrstuvwxyz 0123456789 NO STEP'))
    scale = float(rng.uniform(0.3, 2.0))
    for row in range(int(22 * scale), height, max(int(26 * scale), 8)):
        line = ''.join(rng.choice(letters, max(int(width / (16 * scale)), 3)))
        cv2.putText(image, line, (4, row), cv2.FONT_HERSHEY_SIMPLEX, scale, colour, 2)
    return image


def _other_stripes(rng: np.random.Generator, base: Image) -> Image:
    """Stripes of another make: level, aslant, square, circular, of any width."""
    y, x = np.mgrid[: base.shape[0], : base.shape[1]].astype(float)
    angle, period = rng.uniform(0, np.pi), np.exp(rng.uniform(np.log(3), np.log(120)))
    along = rng.choice([0, 1])
    place = (
        np.hypot(x - x.mean(), y - y.mean()) if along else x * np.cos(angle) + y * np.sin(angle)
    )
    wave = np.cos(2 * np.pi * place / period)
    wave = np.sign(wave) if rng.integers(2) else wave
    level = rng.uniform(60, 128) + rng.uniform(10, 60) * wave
    return _levels(level[..., None] * rng.uniform(0.5, 1, 3) + rng.normal(0, 2, base.shape))


def _cropped(rng: np.random.Generator, base: Image) -> Image:
    """A part in its place, black around it."""
    image = np.zeros_like(base)
    part = _part(rng, base)
    image[part] = base[part]
    return image


def _covered(rng: np.random.Generator, base: Image) -> Image:
    """All but a part that something stands before."""
    image = base.copy()
    part = _part(rng, base)
    image[part] = rng.integers(0, 256, 3, np.uint8)
    return image


def _turned(rng: np.random.Generator, base: Image) -> Image:
    height, width = base.shape[:2]
    by = cv2.getRotationMatrix2D((width / 2, height / 2), rng.uniform(0, 360), rng.uniform(0.5, 2))
    return cv2.warpAffine(base, by, (width, height))


def _flipped(rng: np.random.Generator, base: Image) -> Image:
    return (base[::-1], base[:, ::-1], base[::-1, ::-1])[rng.integers(3)]


def _tiles(rng: np.random.Generator, base: Image) -> Image:
    """Tiles of the photograph in any order."""
    image = base.copy()
    rows, columns = rng.integers(2, 9, 2)
    high, wide = base.shape[0] // rows, base.shape[1] // columns
    order = rng.permutation(rows * columns)
    for to, place in enumerate(order):
        (i, j), (k, m) = divmod(to, columns), divmod(place, columns)
        image[i * high : (i + 1) * high, j * wide : (j + 1) * wide] = base[
            k * high : (k + 1) * high, m * wide : (m + 1) * wide
        ]
    return image


def _levelled(rng: np.random.Generator, base: Image) -> Image:
    """Inverted, thresholded or with few levels."""
    step = int(rng.integers(2, 6))
    choices = (
        255 - base,
        (base > rng.integers(10, 120)) * 255,
        base // (256 // step) * (255 // step),
    )
    return _levels(choices[rng.integers(3)])


def _mixed(rng: np.random.Generator, base: Image) -> Image:
    """Two photographs in one: the camera has moved."""
    other = np.roll(base, tuple(rng.integers(3, 60, 2)), axis=(0, 1))
    return _levels(0.5 * base + 0.5 * other)


def _sunk(rng: np.random.Generator, base: Image) -> Image:
    """The true photograph, weaker and weaker under noise."""
    part = np.exp(rng.uniform(np.log(0.01), 0))
    return _levels(part * base + (1 - part) * 100 + rng.normal(0, rng.uniform(2, 20), base.shape))


def _bright(rng: np.random.Generator, base: Image) -> Image:
    return _levels(base * np.exp(rng.uniform(-3, 3)) + rng.uniform(-40, 40))


def _part(rng: np.random.Generator, base: Image) -> tuple[slice, slice]:
    """A window of any size."""
    ends = []
    for length in base.shape[:2]:
        size = int(rng.integers(max(length // 20, 4), length))
        start = int(rng.integers(0, length - size + 1))
        ends.append(slice(start, start + size))
    return ends[0], ends[1]


def _levels(values: NDArray) -> Image:
    return np.clip(np.rint(values), 0, 255).astype(np.uint8)


KINDS: dict[str, tuple[str, Maker]] = {
    'random bytes': (NOTHING, _bytes),
    'normal noise': (NOTHING, _normal),
    'blurred noise': (NOTHING, _blurred_noise),
    'dark': (NOTHING, _dead),
    'noise with a red stripe': (NOTHING, _reddened_noise),
    'gradient': (NOTHING, _gradient),
    'text': (NOTHING, _text),
    'other stripes': (NOTHING, _other_stripes),
    'cropped': (TRUE, _cropped),
    'covered': (TRUE, _covered),
    'sunk in noise': (TRUE, _sunk),
    'brighter or darker': (TRUE, _bright),
    'turned': (ANY, _turned),
    'flipped': (ANY, _flipped),
    'tiles': (ANY, _tiles),
    'levels': (ANY, _levelled),
    'two in one': (ANY, _mixed),
}
