"""Kinds of light that nothing was built on: lamps, sun and lasers."""

from __future__ import annotations

import math

import numpy as np
from outside_panels import Generator, Outside, plain
from outside_renderer import FRINGE
from outside_sensors import vignette


def dim_corners(rng: Generator) -> Outside:
    """Projector and camera both give their corners little."""

    def lamp(u, v, rows):
        square = (u / 1280 - 0.5) ** 2 + (v / 720 - 0.5) ** 2
        return (1 / (1 + 1.5 * square) ** 4)[:, None]

    return plain(rng, {'lens': vignette}, lamp=lamp)


def blinds(rng: Generator) -> Outside:
    """Sun through a scaffold's grating, in stripes about as wide as fringes, soft edges."""
    pitch, turn = FRINGE * rng.uniform(0.9, 1.4), rng.uniform(-0.2, 0.2)
    shift, strength = rng.uniform(0, 1), rng.uniform(0.3, 0.5)

    def sun(place, rows):
        phase = (place[:, 0] + turn * place[:, 1]) / pitch + shift
        stripes = np.clip(0.5 + 1.5 * np.cos(2 * math.pi * phase), 0, 1)
        within = 1 / (1 + np.exp(-(place[:, :1] + 0.02) / 0.01))
        return 0.03 + strength * stripes[:, None] * within

    return plain(rng, ambient=sun, exposure=0.7)


def other_projector(rng: Generator) -> Outside:
    """Another drone's fringes on the same skin, from the left, a third as bright."""
    pitch, turn = FRINGE * rng.uniform(0.8, 1.5), rng.uniform(-0.6, 0.6)

    def other(place, rows):
        along = math.cos(turn) * place[:, :1] + math.sin(turn) * place[:, 1:]
        beam = 1 / (1 + np.exp((place[:, :1] - 0.03) / 0.004))
        return 0.03 + 0.15 * beam * (1 + np.cos(2 * math.pi * along / pitch))

    return plain(rng, ambient=other, exposure=0.8)


def laser_line(rng: Generator) -> Outside:
    """A green cross of a laser, as range finders show."""
    at, slope = rng.uniform(-0.05, 0.05), rng.uniform(-0.2, 0.2)

    def line(place, rows):
        level = place[:, 1] - at - slope * place[:, 0]
        upright = place[:, 0] + 0.07 + slope * place[:, 1]
        light = np.exp(-((level / 0.0012) ** 2)) + np.exp(-((upright / 0.0012) ** 2))
        return 0.03 + light[:, None] * np.array([0.05, 1.6, 0.1])

    return plain(rng, ambient=line, exposure=0.9)


def colour_wheel(rng: Generator) -> Outside:
    """A rolling shutter before a projector that shows its colours one after the other."""
    lines = rng.uniform(90, 260)

    def lamp(u, v, rows):
        phases = rows[:, None] / lines + np.array([0, 1 / 3, 2 / 3])
        return 1 + 0.35 * np.cos(2 * math.pi * phases)

    return plain(rng, lamp=lamp, exposure=0.75)


def mains_flicker(rng: Generator) -> Outside:
    """Hangar lamps at 100 Hz through a rolling shutter: daylight in bands."""
    lines = rng.uniform(60, 200)

    def ambient(place, rows):
        return 0.5 * (1 + 0.5 * np.cos(2 * math.pi * rows / lines))[:, None]

    return plain(rng, ambient=ambient, exposure=0.6)


def strobe(rng: Generator) -> Outside:
    """An anti-collision flash while some of the rows were exposed."""
    first, last = np.sort(rng.uniform(60, 390, 2))

    def ambient(place, rows):
        on = (rows > first) & (rows < last)
        return 0.03 + 0.4 * on[:, None] * np.array([1.0, 0.75, 0.7])

    return plain(rng, ambient=ambient, exposure=0.75)


def headlamp(rng: Generator) -> Outside:
    """At night, an inspector's lamp: a bright spot with rings and a sharp rim, on a dent."""
    x0, y0 = rng.uniform(-0.08, 0.08), rng.uniform(-0.04, 0.04)

    def spot(place, rows):
        far = np.hypot(place[:, 0] - x0, 1.2 * (place[:, 1] - y0))
        beam = 0.35 * np.exp(-((far / 0.03) ** 2)) + 0.15 * (1 + 0.3 * np.cos(far / 0.0025))
        return (0.005 + beam / (1 + np.exp((far - 0.07) / 0.0008)))[:, None]

    return plain(rng, ambient=spot, exposure=0.85)


def far_stripes(rng: Generator) -> Outside:
    """Light through a blind in a door: soft stripes 2 to 3 fringes wide over all of the skin."""
    pitch, turn = FRINGE * rng.uniform(2.0, 3.2), rng.uniform(-0.3, 0.3)

    def sun(place, rows):
        along = math.cos(turn) * place[:, 0] + math.sin(turn) * place[:, 1]
        return 0.03 + 0.3 * (1 + 0.8 * np.cos(2 * math.pi * along / pitch))[:, None]

    return plain(rng, ambient=sun, exposure=0.7)
