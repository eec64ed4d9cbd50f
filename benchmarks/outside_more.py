"""Kinds that were thought of last, and built before any was looked at."""

from __future__ import annotations

import math

import cv2
import numpy as np
from outside_panels import Generator, Outside, plain, three
from outside_parts import Screen
from outside_renderer import DISTANCE, FRINGE, flat, projected
from outside_sensors import Image
from scipy.ndimage import map_coordinates

_WHITE = 0.75


def fence(rng: Generator) -> Outside:
    """Wires 0.8 mm thick, 60 mm apart, dark, 50 mm before the skin, and a rope of 4 mm."""
    turn, slope = rng.uniform(0.2, 1.3), rng.uniform(-0.4, 0.4)

    def wires(x, y):
        across = math.cos(turn) * y - math.sin(turn) * x
        return np.abs(np.mod(across / 0.06, 1) - 0.5) * 0.06 < 0.0004

    def rope(x, y):
        return np.abs(y - slope * x - 0.02 - 0.01 * np.cos(x / 0.1)) < 0.002

    screens = Screen(DISTANCE - 0.05, wires, 0.15), Screen(DISTANCE - 0.15, rope, 0.45)
    return plain(rng, screens=screens)


def lens_colours(rng: Generator) -> Outside:
    """The camera's lens shows red larger than blue, by a pixel at the corners; blue livery."""
    most, at = rng.uniform(0.5, 1.0), rng.uniform(-0.05, 0.05)

    def fringed(light: Image, _: Generator) -> Image:
        height, width = light.shape[:2]
        rows, columns = np.mgrid[:height, :width].astype(np.float32)
        x, y = columns - width / 2 + 0.5, rows - height / 2 + 0.5
        square = (x * x + y * y) / ((width / 2) ** 2 + (height / 2) ** 2)
        layers = []
        # Calibrated in grey, whose colours weigh 0.3, 0.59 and 0.11.
        for channel, way in enumerate((-0.8, 0.2, 1.067)):
            share = way * most / (width / 2) * (0.7 + 0.3 * square)
            place = rows + share * y, columns + share * x
            # Cubics and 1/32 of a pixel, as OpenCV has them, move fringes by 0.01 pixels.
            layers.append(map_coordinates(light[..., channel], place, mode='reflect'))
        return np.stack(layers, axis=-1)

    def albedo(place):
        blue = np.abs(place[:, :1] - at) < 0.05
        return np.where(blue, np.array([[0.05, 0.1, 0.5]]), _WHITE)

    return plain(rng, {'lens': fringed}, albedo=albedo)


def corroded(rng: Generator) -> Outside:
    """Blisters under paint: some fifty bumps of 2 to 5 mm, 0.05 to 0.2 mm high."""
    x, y = rng.uniform(0.0, 0.2, 50), rng.uniform(-0.1, 0.1, 50)
    radius, height = rng.uniform(0.001, 0.0025, 50), rng.uniform(5e-5, 2e-4, 50)

    def skin(places_x, places_y, moment):
        total = flat(places_x, places_y, moment)
        for a, b, r, h in zip(x, y, radius, height, strict=True):
            square = ((places_x - a) ** 2 + (places_y - b) ** 2) / r**2
            total = total - h * np.exp(-np.minimum(square, 50))
        return total

    things = tuple(zip(x, y, 2 * radius, strict=True))
    places = (-0.15, -0.04), (-0.05, 0.03), (-0.15, 0.07)
    return plain(rng, skin=skin, dimples=three(rng, *places), things=things)


def orange_peel(rng: Generator) -> Outside:
    """Paint that has run into waves of 4 to 8 mm, 8 um high, with a soft gloss."""
    count = 40
    turn = rng.uniform(0, 2 * math.pi, count)
    number = 2 * math.pi / rng.uniform(0.004, 0.008, count)
    shift = rng.uniform(0, 6, count)
    size = 8e-6 * math.sqrt(2 / count)

    def skin(x, y, moment):
        total = flat(x, y, moment)
        for a, k, s in zip(turn, number, shift, strict=True):
            total = total + size * np.sin(k * (math.cos(a) * x + math.sin(a) * y) + s)
        return total

    return plain(rng, skin=skin, gloss=0.3, roughness=0.15, exposure=0.9)


def icing(rng: Generator) -> Outside:
    """Clear ice over a part: light goes through a layer of 1 to 2 mm, and half shines back."""
    at, thick, shift = rng.uniform(-0.03, 0.06), rng.uniform(0.001, 0.002), rng.uniform(0, 6)

    def layer(place):
        edge = place[:, 0] - at - 0.015 * np.sin(place[:, 1] / 0.02 + shift)
        return thick / (1 + np.exp(-edge / 0.003))

    def bend(world, hits):
        # Seen through ice, the skin lies nearer by a quarter of the layer.
        depth = 0.25 * layer(hits.points[:, :2])
        way = hits.view[:, :2] / hits.view[:, 2:] - hits.lamp[:, :2] / hits.lamp[:, 2:]
        shift = depth[:, None] * way
        return np.concatenate([shift, np.zeros((len(shift), 1))], axis=1)

    def shine(world, hits):
        image = world.slide(world.pattern.draw().astype(np.float32) / 255)
        lobe = np.exp(-((np.arccos(hits.half()) / 0.2) ** 2)) * layer(hits.points[:, :2]) / thick
        return (0.15 * lobe)[:, None] * projected(image, hits.u, hits.v)

    places = (-0.14, -0.04), (-0.12, 0.05), (-0.18, 0.08)
    things = tuple((0.02 * k, 0.02 * j, 0.03) for k in range(-3, 14) for j in range(-7, 8))
    return plain(rng, bend=bend, more=shine, dimples=three(rng, *places), things=things)


def vibrating(rng: Generator) -> Outside:
    """Projector and camera shake against each other: fringes smeared by half a period in bands."""
    lines, shift = rng.uniform(60, 200), rng.uniform(0, 6)

    def smeared(light: Image, _: Generator) -> Image:
        soft = cv2.blur(light, (5, 1))
        rows = np.arange(len(light), dtype=np.float32)[:, None, None]
        share = 0.5 + 0.5 * np.sin(2 * math.pi * rows / lines + shift)
        return (share * soft + (1 - share) * light).astype(np.float32)

    return plain(rng, {'lens': smeared})


def hdr(rng: Generator) -> Outside:
    """Two exposures that the camera merges: a curve with a kink, and edges where they meet."""
    knee, slope = rng.uniform(0.35, 0.55), rng.uniform(0.4, 0.6)

    def merged(signal: Image, _: Generator) -> Image:
        return np.where(signal < knee, signal, knee + slope * (signal - knee)).astype(np.float32)

    return plain(rng, {'curve': merged})


def interlaced(rng: Generator) -> Outside:
    """Odd rows from the next half picture: the drone moved by half a pixel, light by 4 %."""
    way, gain = rng.uniform(0.2, 0.6), rng.uniform(0.94, 1.06)

    def woven(light: Image, _: Generator) -> Image:
        # The middle moment is that of the light: the brighter half picture is nearer to it.
        shares = way * gain / (1 + gain), way / (1 + gain)
        before, after = (
            (1 - share) * light + share * np.roll(light, side, axis=1)
            for share, side in zip(shares, (-1, 1), strict=True)
        )
        before[1::2] = gain * after[1::2]
        return before.astype(np.float32)

    return plain(rng, {'lens': woven})


def hatched(rng: Generator) -> Outside:
    """Hatching for "no step": stripes 0.6 to 0.9 fringes apart, aslant by 20 to 70 degrees."""
    pitch, turn = FRINGE * rng.uniform(0.6, 0.9), math.radians(rng.uniform(20, 70))

    def albedo(place):
        along = math.cos(turn) * place[:, 0] + math.sin(turn) * place[:, 1]
        within = np.hypot(place[:, 0] - 0.05, place[:, 1] - 0.02) < 0.07
        return np.where(within & (np.mod(along / pitch, 1) < 0.3), 0.25, _WHITE)[:, None]

    return plain(rng, albedo=albedo)


def reflected(rng: Generator) -> Outside:
    """A shiny floor or wing throws a tenth of the projector's light back, blurred and mirrored."""
    share, turn = rng.uniform(0.05, 0.1), rng.uniform(-0.2, 0.2)

    def thrown(world, hits):
        image = world.slide(world.pattern.draw().astype(np.float32) / 255)
        soft = cv2.GaussianBlur(image, (0, 0), 6.0)
        return share * projected(soft, 1279 - 0.9 * hits.u - turn * hits.v, 0.9 * hits.v)

    return plain(rng, more=thrown, exposure=0.9)
