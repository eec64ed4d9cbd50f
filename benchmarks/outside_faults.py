"""Kinds of faults of lamps, projectors, sensors and drivers that nothing was built on."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray
from outside_panels import Generator, Outside, plain
from outside_renderer import slide
from outside_sensors import Image


def dimmed_lamp(rng: Generator) -> Outside:
    """A lamp that is dimmed by pulses: the projector's light in bands of 5 to 20 rows, by 10 %."""
    lines, depth, shift = rng.uniform(5, 20), rng.uniform(0.05, 0.15), rng.uniform(0, 6)

    def lamp(u, v, rows):
        return (1 + depth * np.cos(2 * math.pi * rows / lines + shift))[:, None]

    return plain(rng, lamp=lamp, exposure=0.85)


def caustics(rng: Generator) -> Outside:
    """The sun by way of water on the floor: a net of bright lines 1 to 3 mm wide."""
    turn, number = rng.uniform(0, math.pi, 5), 2 * math.pi / rng.uniform(0.025, 0.06, 5)
    shift = rng.uniform(0, 6, 5)

    def sun(place, rows):
        x, y = place.T
        waves = sum(
            np.sin(k * (math.cos(a) * x + math.sin(a) * y) + s)
            for a, k, s in zip(turn, number, shift, strict=True)
        )
        return (0.06 + 0.3 * np.exp(-((waves / 0.25) ** 2)))[:, None]

    return plain(rng, ambient=sun, exposure=0.75)


def overscan(rng: Generator) -> Outside:
    """A projector set as a television: its image 2 to 3 % larger than the panel."""
    scale = rng.uniform(1.02, 1.03)

    def larger(drawn: Image) -> Image:
        middle = np.array(drawn.shape[1::-1]) / 2 - 0.5
        matrix = np.array([[scale, 0, 0], [0, scale, 0]])
        matrix[:, 2] = (1 - scale) * middle
        grown = cv2.warpAffine(drawn, matrix, drawn.shape[1::-1], flags=cv2.INTER_LINEAR)
        return slide(np.asarray(grown, np.float32))

    return plain(rng, slide=larger)


def smeared_charge(light: Image, rng: Generator) -> Image:
    """A sensor without shutter: glints so bright that they leak along their columns."""
    height, width = light.shape[:2]
    rows, columns = np.mgrid[:height, :width].astype(np.float32)
    glints = np.zeros((height, width), np.float32)
    for _ in range(5):
        row, column = rng.uniform(0, height), rng.uniform(0, width)
        far = np.hypot(rows - row, columns - column)
        glints += 15 * np.exp(-((far / rng.uniform(2, 5)) ** 2))
    leak = 0.0008 * np.clip(glints, 0, None).sum(axis=0)
    return light + (glints + leak)[..., None]


def warm_sensor(signal: Image, rng: Generator) -> Image:
    """A warm sensor: pixels that glow, one in 250, gains of their own by 1 %, a bright corner."""
    height, width = signal.shape[:2]
    rows, columns = np.mgrid[:height, :width].astype(np.float32)
    hot = (rng.random((height, width)) < 0.004) * rng.exponential(0.15, (height, width))
    glow = 0.08 * np.exp(-np.hypot(rows, width - columns) / 150)
    gains = 1 + 0.01 * rng.standard_normal((height, width, 1))
    return np.asarray(signal * gains + (hot + glow)[..., None], np.float32)


def white_balance(signal: Image, rng: Generator) -> Image:
    """A white balance for another lamp: red by 1.7 and blue by 1.4, and red clipped."""
    return signal * np.array([1.7, 1.0, 1.4], np.float32)


def two_amplifiers(signal: Image, rng: Generator) -> Image:
    """Odd rows by another amplifier: 3 % stronger, two levels brighter."""
    out = signal.copy()
    out[1::2] = 1.03 * out[1::2] + 2 / 255
    return out


def few_bits(picture: NDArray, rng: Generator) -> NDArray:
    """Pixels of 16 bits for three colours: five, six and five of them."""
    lost = np.array([3, 2, 3], np.uint8)
    return np.asarray((picture >> lost) << lost)


def lost_packets(picture: NDArray, rng: Generator) -> NDArray:
    """Packets of the network that did not come: runs of one to three rows, black."""
    out = picture.copy()
    for _ in range(15):
        row, column = rng.integers(0, out.shape[0] - 3), rng.integers(0, out.shape[1] - 200)
        out[row : row + rng.integers(1, 4), column : column + rng.integers(80, 500)] = 0
    return out


def half_frame(picture: NDArray, rng: Generator) -> NDArray:
    """A picture that ends half way: the rest is the grey that a decoder fills in."""
    out = picture.copy()
    row = int(rng.uniform(0.55, 0.8) * len(out)) // 16 * 16
    out[row:] = 128
    return out
