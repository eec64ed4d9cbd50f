"""Kinds of finishes and parts of aircraft that nothing was built on."""

from __future__ import annotations

import math

import cv2
import numpy as np
from outside_panels import Generator, Outside, plain
from outside_renderer import FRINGE, flat, projected, slide

_WHITE = 0.75


def acoustic_liner(rng: Generator) -> Outside:
    """An intake's liner: holes of 1.6 mm, 5 mm apart, over half of the view."""
    at, pitch = rng.uniform(-0.02, 0.06), rng.uniform(0.0045, 0.0055)

    def hole(x, y):
        row = np.round(y / (pitch * math.sqrt(0.75)))
        across = np.mod(x / pitch + 0.5 * np.mod(row, 2) + 0.5, 1) - 0.5
        along = y - row * pitch * math.sqrt(0.75)
        return (np.hypot(across * pitch, along) < 0.0008) & (x > at)

    def skin(x, y, moment):
        return flat(x, y, moment) + 0.006 * hole(x, y)

    def albedo(place):
        return np.where(hole(*place.T), 0.03, 0.5)[:, None]

    return plain(rng, skin=skin, albedo=albedo)


def placard(rng: Generator) -> Outside:
    """A label with lines as far apart as fringes, within 3 %, and nearly along them."""
    pitch, turn = FRINGE * rng.uniform(0.97, 1.03), math.radians(rng.uniform(-3, 3))
    x0, y0 = rng.uniform(-0.05, 0.05), rng.uniform(-0.03, 0.03)

    def albedo(place):
        x, y = place.T - np.array([[x0], [y0]])
        line = np.mod((math.cos(turn) * x + math.sin(turn) * y) / pitch, 1) < 0.4
        on = (np.abs(x) < 0.04) & (np.abs(y) < 0.025)
        return np.where(on, np.where(line, 0.25, 0.8), 0.6)[:, None]

    return plain(rng, albedo=albedo)


def matt_tape(rng: Generator) -> Outside:
    """Adhesive tape, half transparent and 50 um thick, across a dent: light spreads in it."""
    turn, at = rng.uniform(-0.6, 0.6), rng.uniform(0.08, 0.12)

    def on(x, y):
        return np.abs(math.cos(turn) * (x - at) + math.sin(turn) * y) < 0.0125

    def skin(x, y, moment):
        return flat(x, y, moment) - 5e-5 * on(x, y)

    def albedo(place):
        return np.where(on(*place.T), 0.4, _WHITE)[:, None]

    def spread(world, hits):
        image = world.slide(world.pattern.draw().astype(np.float32) / 255)
        soft = cv2.GaussianBlur(image, (0, 0), 3.0)
        return 0.3 * on(*hits.points[:, :2].T)[:, None] * projected(soft, hits.u, hits.v)

    return plain(rng, skin=skin, albedo=albedo, more=spread)


def radome(rng: Generator) -> Outside:
    """Glass fibre that light goes into: two fifths come out 1 to 2.5 mm beside."""
    width = rng.uniform(2.5, 6.0)

    def spread(drawn):
        image = slide(drawn)
        return 0.6 * image + 0.4 * cv2.GaussianBlur(image, (0, 0), width)

    return plain(rng, slide=spread)


def retroreflective(rng: Generator) -> Outside:
    """Tape with glass beads that throws five times the light back, clipped, in strips of 30 mm."""
    at, turn = rng.uniform(-0.03, 0.03), rng.uniform(-0.3, 0.3)

    def beads(world, hits):
        image = world.slide(world.pattern.draw().astype(np.float32) / 255)
        x, y = hits.points[:, :2].T
        on = np.abs(y - at - turn * x) < 0.015
        return (2.5 * on)[:, None] * projected(image, hits.u, hits.v)

    return plain(rng, more=beads)


def halftone(rng: Generator) -> Outside:
    """Printed film: a picture of dots 1.0 to 1.5 mm apart, two pixels, at 45 degrees."""
    pitch, size = rng.uniform(0.0010, 0.0015), rng.uniform(0.05, 0.1)
    shift = rng.uniform(0, 6, 2)

    def albedo(place):
        x, y = place.T
        shade = 0.25 + 0.2 * np.sin(x / size * 6 + shift[0]) * np.sin(y / size * 6 + shift[1])
        dots = np.cos(2 * math.pi * (x + y) / (pitch * math.sqrt(2)))
        dots = dots + np.cos(2 * math.pi * (x - y) / (pitch * math.sqrt(2)))
        return np.where(dots > 2 - 4 * shade, 0.2, _WHITE)[:, None]

    return plain(rng, albedo=albedo)


def vortex_generators(rng: Generator) -> Outside:
    """A row of small fins 6 mm high and 30 mm long, 50 mm apart, aslant in turns."""
    at, start = rng.uniform(-0.02, 0.03), rng.uniform(-0.2, -0.15)
    middles = start + 0.05 * np.arange(8)

    def skin(x, y, moment):
        total = flat(x, y, moment)
        for number, middle in enumerate(middles):
            turn = 0.3 * (-1) ** number
            along = math.cos(turn) * (y - at) + math.sin(turn) * (x - middle)
            across = math.cos(turn) * (x - middle) - math.sin(turn) * (y - at)
            away = np.maximum(np.abs(along) / 0.015, np.abs(across) / 0.0025)
            total = total - 0.006 * np.clip((1 - away) / 0.8, 0, 1)
        return total

    things = tuple((float(x), at + y, 0.012) for x in middles for y in (-0.01, 0.0, 0.01))
    return plain(rng, skin=skin, things=things)


def wet_film(rng: Generator) -> Outside:
    """A film of water that runs down half of the skin: 0.1 to 0.3 mm, ripples, and a shine."""
    at, thick = rng.uniform(-0.02, 0.05), rng.uniform(1e-4, 3e-4)
    shift, length = rng.uniform(0, 6, 2), rng.uniform(0.012, 0.03)

    def layer(place):
        x, y = place.T
        edge = x - at - 0.01 * np.sin(y / 0.025 + shift[0])
        waves = 1 + 0.2 * np.sin(2 * math.pi * (y + 0.3 * x) / length + shift[1])
        return thick * waves / (1 + np.exp(-edge / 0.002))

    def bend(world, hits):
        # Seen through water, the skin lies nearer by a quarter of the film.
        way = hits.view[:, :2] / hits.view[:, 2:] - hits.lamp[:, :2] / hits.lamp[:, 2:]
        shift = 0.25 * layer(hits.points[:, :2])[:, None] * way
        return np.concatenate([shift, np.zeros((len(shift), 1))], axis=1)

    def shine(world, hits):
        image = world.slide(world.pattern.draw().astype(np.float32) / 255)
        lobe = np.exp(-((np.arccos(hits.half()) / 0.08) ** 2)) * layer(hits.points[:, :2]) / thick
        return (0.3 * lobe)[:, None] * projected(image, hits.u, hits.v)

    return plain(rng, bend=bend, more=shine)


def stress_colours(rng: Generator) -> Outside:
    """Acrylic between polarisers: rings of colour, 6 to 12 mm wide, over a window of 80 mm."""
    x0, y0, width = rng.uniform(-0.05, 0.08), rng.uniform(-0.03, 0.03), rng.uniform(0.006, 0.012)

    def albedo(place):
        far = np.hypot(place[:, 0] - x0, 1.3 * (place[:, 1] - y0))
        order = far[:, None] / width * np.array([0.8, 1.0, 1.25])
        rings = 0.45 * (1 + 0.35 * np.cos(2 * math.pi * order))
        return np.where((far < 0.08)[:, None], rings, _WHITE)

    return plain(rng, albedo=albedo)


def wing_flex(rng: Generator) -> Outside:
    """A wing that springs in a gust: up to 1 mm, most at its tip, while the picture is taken."""
    bend, way = rng.uniform(0.5e-3, 1e-3), rng.choice([-1, 1])

    def skin(x, y, moment):
        return flat(x, y, moment) + way * bend * ((x + 0.25) / 0.5) ** 2 * moment

    return plain(rng, skin=skin)
