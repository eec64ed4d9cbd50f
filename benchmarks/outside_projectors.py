"""Kinds of projectors that nothing was built on: what they make of the pattern."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray
from outside_panels import Generator, Outside, plain
from outside_renderer import slide
from outside_sensors import blobs
from scipy.ndimage import map_coordinates

Image = NDArray[np.float32]


def focused_aslant(rng: Generator) -> Outside:
    """Sharp in one corner of the frame, a blur of 4 pixels in the opposite one."""
    turn = rng.uniform(0, 2 * math.pi)

    def unsharp(drawn: Image) -> Image:
        rows, columns = np.mgrid[: drawn.shape[0], : drawn.shape[1]].astype(np.float32)
        along = math.cos(turn) * (columns / 1280 - 0.5) + math.sin(turn) * (rows / 720 - 0.5)
        share = np.clip(along / 1.4 + 0.5, 0, 1)[..., None]
        layers = [cv2.GaussianBlur(slide(drawn), (0, 0), s) for s in np.linspace(0.3, 4.0, 9)]
        place = share * (len(layers) - 1)
        weights = (np.clip(1 - np.abs(place - i), 0, 1) for i in range(len(layers)))
        return sum(w * layer for w, layer in zip(weights, layers, strict=True))

    return plain(rng, slide=unsharp)


def dusty_projector(rng: Generator) -> Outside:
    """Dust on the panel's glass and a hair: spots of 8 to 25 pixels that dim by half, a line."""
    maker = np.random.default_rng(rng.integers(1 << 31))
    x0, y0, turn = rng.uniform(300, 900), rng.uniform(200, 500), rng.uniform(0, math.pi)

    def dusty(drawn: Image) -> Image:
        spots = 0.5 * blobs(drawn.shape, maker, 25, (8, 25))[..., None]
        rows, columns = np.mgrid[: drawn.shape[0], : drawn.shape[1]].astype(np.float32)
        along = math.cos(turn) * (columns - x0) + math.sin(turn) * (rows - y0)
        across = math.cos(turn) * (rows - y0) - math.sin(turn) * (columns - x0)
        curl = across - 12 * np.sin(along / 40)
        hair = 0.6 * np.exp(-((curl / 2.0) ** 2)) * (np.abs(along) < 130)
        return slide(drawn) * (1 - spots) * (1 - hair[..., None])

    return plain(rng, slide=dusty)


def off_gamma(rng: Generator) -> Outside:
    """A projector whose light is a power of 1.1 of its levels, and whose black is a quarter."""
    power = 1.1 ** rng.choice([-1, 1])
    return plain(rng, slide=lambda drawn: 0.25 + 0.75 * slide(drawn) ** power, exposure=0.8)


def chromatic(rng: Generator) -> Outside:
    """Red a pixel larger than green at the frame's corners, blue smaller; red and white paint."""
    scale = rng.uniform(0.6, 1.2) / math.hypot(640, 360)

    def fringed(drawn: Image) -> Image:
        rows, columns = np.mgrid[: drawn.shape[0], : drawn.shape[1]].astype(np.float32)
        image = slide(drawn)
        layers = []
        # Calibrated in grey, whose colours weigh 0.3, 0.59 and 0.11.
        for channel, way in enumerate((-0.81, 0.19, 1.19)):
            u = columns + way * scale * (columns - 639.5)
            v = rows + way * scale * (rows - 359.5)
            # OpenCV rounds places to 1/32 pixel, as much as colours are told apart here.
            layers.append(map_coordinates(image[..., channel], (v, u), mode='nearest'))
        return np.stack(layers, axis=-1)

    at, slope = rng.uniform(0.02, 0.1), rng.uniform(-0.3, 0.3)

    def albedo(place):
        red = place[:, :1] - slope * place[:, 1:] > at
        return np.where(red, np.array([[0.6, 0.06, 0.05]]), 0.75)

    return plain(rng, albedo=albedo, slide=fringed)


def dithered(rng: Generator) -> Outside:
    """A panel of mirrors that dithers its levels: each pixel and colour off by 6 % of white."""
    maker = np.random.default_rng(rng.integers(1 << 31))

    def grainy(drawn: Image) -> Image:
        grain = 0.06 * maker.standard_normal(drawn.shape).astype(np.float32)
        return slide(np.clip(drawn + grain, 0, 1))

    return plain(rng, slide=grainy)


def ghost(rng: Generator) -> Outside:
    """Light between two lenses of the projector: its image turned about the middle, 3 to 5 %."""
    share = rng.uniform(0.03, 0.05)

    def doubled(drawn: Image) -> Image:
        image = slide(drawn)
        return image + share * cv2.GaussianBlur(image[::-1, ::-1].copy(), (0, 0), 1.5)

    return plain(rng, slide=doubled, exposure=0.95)


def pulsed(rng: Generator) -> Outside:
    """Lamps that are switched, before a rolling shutter: rows with a third of the light."""
    lines, lit, shift = rng.uniform(40, 140), rng.uniform(0.5, 0.8), rng.uniform(0, 1)

    def lamp(u, v, rows):
        # A row gathers light for some rows' time.
        level = np.mod(rows / lines + shift, 1)
        ramp = 6 / lines
        on = np.clip(level / ramp, 0, 1) * np.clip((lit - level) / ramp + 1, 0, 1)
        return (0.3 + 0.7 * on)[:, None]

    return plain(rng, lamp=lamp)
