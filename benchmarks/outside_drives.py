"""Kinds of drives that nothing was built on: mirrors, scanners and keystones, and raking sun."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray
from outside_panels import Generator, Outside, plain
from outside_renderer import projected, slide

Image = NDArray[np.float32]


def bit_planes(rng: Generator) -> Outside:
    """Mirrors that show bits one after the other, and an exposure that misses a part of one."""
    weights = 2.0 ** np.arange(8)
    missed = int(rng.integers(4, 7))
    weights[missed] *= rng.uniform(0.3, 0.8)

    def shown(drawn: Image) -> Image:
        levels = np.rint(255 * drawn).astype(int)
        light = sum(w * ((levels >> k) & 1) for k, w in enumerate(weights)) / weights.sum()
        return slide(light.astype(np.float32))

    return plain(rng, slide=shown)


def scanned(rng: Generator) -> Outside:
    """A laser that writes lines to and fro, a third to two pixels apart, with speckle."""
    shift = rng.uniform(0.3, 2.0)
    grain = cv2.GaussianBlur(rng.normal(0, 1, (450, 800, 3)).astype(np.float32), (0, 0), 0.7)
    grain *= 0.06 / grain.std()

    def written(drawn: Image) -> Image:
        image = slide(drawn)
        there, back = (
            cv2.warpAffine(image, np.array([[1, 0, way], [0, 1, 0]]), (1280, 720))
            for way in (shift / 2, -shift / 2)
        )
        there[1::2] = back[1::2]
        return there

    return plain(rng, {'lens': lambda light, _: light * (1 + grain)}, slide=written)


def keystone(rng: Generator) -> Outside:
    """A projector that corrects for a wall that is not there: upper edge narrower by 1 to 3 %."""
    share = rng.uniform(0.01, 0.03)
    corners = np.array([[0, 0], [1279, 0], [1279, 719], [0, 719]], np.float32)
    inset = np.array([[1, 0], [-1, 0], [0, 0], [0, 0]], np.float32) * 640 * share
    matrix = cv2.getPerspectiveTransform(corners, corners + inset)

    def warped(drawn: Image) -> Image:
        return cv2.warpPerspective(slide(drawn), matrix, (1280, 720), flags=cv2.INTER_CUBIC)

    return plain(rng, slide=warped)


def raking_sun(rng: Generator) -> Outside:
    """Sun at 5 to 12 degrees to the skin: dents have a bright and a dark side."""
    low, turn = math.radians(rng.uniform(5, 12)), rng.uniform(0, 2 * math.pi)
    way = np.array(
        [math.cos(low) * math.cos(turn), math.cos(low) * math.sin(turn), -math.sin(low)]
    )

    def sun(world, hits):
        facing = np.clip(hits.normals @ way, 0, None) / math.sin(low)
        return (0.75 * 0.35 * facing)[:, None] * np.ones(3)

    return plain(rng, more=sun, exposure=0.7)


def screen_door(rng: Generator) -> Outside:
    """Three panels of liquid crystals: dark lines between pixels, colours half a pixel apart."""
    way = rng.uniform(-0.5, 0.5, 2)

    def doors(drawn: Image) -> Image:
        layers = []
        # Calibrated in grey, whose colours weigh 0.3, 0.59 and 0.11.
        for channel, part in enumerate((0.81, -0.19, -1.19)):
            move = np.array([[1, 0, part * way[0]], [0, 1, part * way[1]]])
            layers.append(cv2.warpAffine(drawn[..., channel], move, (1280, 720)))
        return slide(np.stack(layers, axis=-1))

    return plain(rng, slide=doors)


def second_bounce(rng: Generator) -> Outside:
    """A drone's white belly that throws a part of the light back: soft, from the camera's side."""
    share = rng.uniform(0.1, 0.25)

    def back(world, hits):
        image = world.slide(world.pattern.draw().astype(np.float32) / 255)
        even = cv2.GaussianBlur(image, (0, 0), 40.0)
        return (0.75 * share * hits.view[:, 2:] * -1) * projected(even, hits.u, hits.v)

    return plain(rng, more=back, exposure=0.85)


def crushed(signal: Image, rng: Generator) -> Image:
    """A black level set too high: the fringes' troughs are cut off."""
    black = rng.uniform(0.08, 0.2)
    return np.clip((signal - black) / (1 - black), 0, 1).astype(np.float32)


def over_sharpened(picture: NDArray, rng: Generator) -> NDArray:
    """Edges sharpened by twice, with a radius of 2 pixels."""
    light = picture.astype(np.float32)
    sharp = light + 2.0 * (light - cv2.GaussianBlur(light, (0, 0), 2.0))
    return np.clip(np.rint(sharp), 0, 255).astype(np.uint8)


def exchanged(picture: NDArray, rng: Generator) -> NDArray:
    """Blue and red exchanged by the driver."""
    return np.ascontiguousarray(picture[..., ::-1])


def posterised(picture: NDArray, rng: Generator) -> NDArray:
    """Four bits."""
    return (17 * np.rint(picture / 17.0)).astype(np.uint8)


def shifted(picture: NDArray, rng: Generator) -> NDArray:
    """A region of interest that begins elsewhere: 8 columns and 6 rows beside."""
    return np.roll(picture, (6, 8), (0, 1))


def stretched(picture: NDArray, rng: Generator) -> NDArray:
    """Levels stretched until a twentieth is clipped on either side, as programs for people do."""
    low, high = np.percentile(picture, (5, 95))
    return np.clip(np.rint((picture - low) * 255.0 / (high - low)), 0, 255).astype(np.uint8)


def zoomed(picture: NDArray, rng: Generator) -> NDArray:
    """A lens that stabilises: the picture is cropped by 2 % and enlarged again."""
    height, width = picture.shape[:2]
    part = 1.02
    matrix = np.array([[part, 0, (1 - part) * width / 2], [0, part, (1 - part) * height / 2]])
    return cv2.warpAffine(picture, matrix, (width, height), flags=cv2.INTER_CUBIC)
