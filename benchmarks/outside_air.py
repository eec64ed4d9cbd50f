"""Kinds of what is in the air, on the camera's glass or burnt into the picture before the skin."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray
from outside_sensors import Generator, Image
from scipy.ndimage import map_coordinates


def _clouds(shape: tuple[int, ...], rng: Generator, size: float) -> Image:
    """Smooth noise of standard deviation 1, so many pixels wide."""
    noise = rng.standard_normal(shape[:2]).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), size)
    return np.asarray(smooth / smooth.std(), np.float32)


def shimmer(light: Image, rng: Generator) -> Image:
    """Warm air: what is seen sways by 0.1 to 0.2 pixels (0.1 mrad) in billows of 15 to 40."""
    rows, columns = np.mgrid[: light.shape[0], : light.shape[1]].astype(np.float32)
    sway, size = rng.uniform(0.1, 0.2), rng.uniform(15, 40)
    across, along = (sway * _clouds(light.shape, rng, size) for _ in range(2))
    place = rows + along, columns + across
    layers = [map_coordinates(light[..., c], place, mode='nearest') for c in range(3)]
    return np.stack(layers, axis=-1)


def rain(light: Image, rng: Generator) -> Image:
    """Rain that falls past: 70 slant streaks 2 to 5 pixels wide, through which all is blurred."""
    streaks, lean = np.zeros(light.shape[:2], np.float32), rng.uniform(-0.3, 0.3)
    for _ in range(70):
        start = rng.uniform((0, -60), light.shape[1::-1])
        stop = start + rng.uniform(25, 90) * np.array([lean, 1.0])
        ends = (tuple(int(a) for a in p) for p in (start, stop))
        cv2.line(streaks, *ends, float(rng.uniform(0.3, 0.8)), int(rng.integers(2, 6)))
    share = cv2.GaussianBlur(streaks, (0, 0), 1.0)[..., None]
    return (1 - share) * light + share * (0.05 + cv2.GaussianBlur(light, (0, 0), 8.0))


def condensation(light: Image, rng: Generator) -> Image:
    """Breath on cold glass: patches 60 pixels wide that blur all by 4 pixels, and glow."""
    share = 0.8 / (1 + np.exp(-4 * _clouds(light.shape, rng, 60.0)))[..., None]
    wide = cv2.GaussianBlur(light, (0, 0), 40.0)
    soft = 0.8 * cv2.GaussianBlur(light, (0, 0), 4.0) + 0.3 * wide
    return np.asarray((1 - share) * light + share * soft, np.float32)


def insect(light: Image, rng: Generator) -> Image:
    """An insect walks on the lens: a body and six legs, dark, out of focus by 7 pixels."""
    shade = np.zeros(light.shape[:2], np.float32)
    middle = rng.uniform((200, 100), (600, 350))
    turn = rng.uniform(0, math.pi)
    ahead = np.array([math.cos(turn), math.sin(turn)])
    aside = np.array([-ahead[1], ahead[0]])
    at = tuple(int(a) for a in middle)
    cv2.ellipse(shade, at, (45, 16), math.degrees(turn), 0, 360, 1.0, -1)
    for along in (-25, 0, 25):
        for side in (-1, 1):
            foot = middle + 1.4 * along * ahead + 60 * side * aside
            start = middle + along * ahead
            cv2.line(shade, *(tuple(int(a) for a in p) for p in (start, foot)), 1.0, 5)
    share = 0.95 * cv2.GaussianBlur(shade, (0, 0), 7.0)[..., None]
    return (1 - share) * light + 0.01 * share


def propeller(light: Image, rng: Generator) -> Image:
    """A blade sweeps a corner while rows are read: bands, bowed, of four fifths of the light."""
    rows, columns = np.mgrid[: light.shape[0], : light.shape[1]].astype(np.float32)
    far = np.hypot(columns + 60, rows + 80)
    turn = np.arctan2(rows + 80, columns + 60)
    swept = np.clip(0.5 + 2 * np.cos(2 * (turn - rows / rng.uniform(15, 40))), 0, 1)
    share = 0.2 * swept / (1 + np.exp((far - rng.uniform(350, 550)) / 6))
    return np.asarray(light * (1 - share[..., None]) + 0.01 * share[..., None], np.float32)


def overlay(picture: NDArray, rng: Generator) -> NDArray:
    """What a pilot's picture has burnt in: text with outlines, a horizon and a cross."""
    out = np.ascontiguousarray(picture)
    volts, height = rng.uniform(13, 17), rng.uniform(1, 30)
    lines = [
        (f'{volts:.1f}V  REC', (20, 40)),
        (f'ALT {height:.1f}', (620, 40)),
        ('2026-11-23 14:07:52', (20, 430)),
        ('STAB', (640, 430)),
    ]
    for text, place in lines:
        for level, width in ((0, 5), (255, 2)):
            font = cv2.FONT_HERSHEY_SIMPLEX
            cv2.putText(out, text, place, font, 0.8, (level,) * 3, width)
    tilt = int(rng.uniform(-30, 30))
    cv2.line(out, (250, 225 - tilt), (370, 225), (255,) * 3, 2)
    cv2.line(out, (430, 225), (550, 225 + tilt), (255,) * 3, 2)
    cv2.drawMarker(out, (400, 225), (255, 255, 255), cv2.MARKER_CROSS, 20, 2)
    return out
