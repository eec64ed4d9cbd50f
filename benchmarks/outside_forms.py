"""Kinds of forms that nothing was built on: noses, lips, fillets, pillows, ramps and beads."""

from __future__ import annotations

import math

import numpy as np
from outside_panels import Generator, Outside, plain, three
from outside_parts import Dimple
from outside_renderer import DISTANCE, flat


def round_off(far, radius: float, slope: float):
    """Depth of a circle's arc that goes on straight from a slope on, by the way from its top."""
    most = radius * math.sin(math.atan(slope))
    near = np.minimum(np.abs(far), most)
    return radius - np.sqrt(radius**2 - near**2) + slope * (np.abs(far) - near)


def spinner(rng: Generator) -> Outside:
    """A nose or spinner: a ball of 0.15 to 0.25 m radius that goes on as a cone."""
    radius = rng.uniform(0.15, 0.25)

    def skin(x, y, moment):
        return DISTANCE - 0.02 + round_off(np.hypot(x, y), radius, 1.2)

    return plain(rng, skin=skin, dimples=three(rng, (-0.06, -0.03), (0.05, 0.02), (-0.01, 0.08)))


def lip(rng: Generator) -> Outside:
    """An engine's lip: a tube of 40 to 60 mm radius, bent about 0.5 m, and the cowl behind it."""
    radius, bend = rng.uniform(0.04, 0.06), 0.5
    at = rng.uniform(-0.02, 0.03)

    def skin(x, y, moment):
        far = np.hypot(x + bend, y) - bend - at
        return DISTANCE - 0.02 + round_off(far, radius, 0.9)

    dimples = (
        Dimple(at - 0.055, -0.03, 0.03, 0.03, 0.8e-3),
        Dimple(at + 0.005, 0.04, 0.025, 0.02, 0.5e-3, rng.uniform(0, 3)),
        Dimple(at + 0.08, -0.05, 0.025, 0.025, 0.4e-3),
    )
    return plain(rng, skin=skin, dimples=dimples)


def profile(rng: Generator) -> Outside:
    """A wing's nose as a profile has it: depth as the square of the way, then its root."""
    radius, turn = rng.uniform(0.02, 0.04), rng.uniform(-0.5, 0.5)

    def skin(x, y, moment):
        far = math.cos(turn) * x + math.sin(turn) * y
        # A hyperbola: its nose has the radius, and its flanks become straight.
        slope = 1.0
        reach = radius * slope
        return DISTANCE - 0.02 + slope * (np.hypot(far, reach) - reach)

    dimples = three(rng, (-0.09, -0.04), (0.08, 0.03), (0.0, 0.07))
    return plain(rng, skin=skin, dimples=dimples)


def tangent(rng: Generator) -> Outside:
    """A flat panel that goes over into a bend of 60 to 120 mm radius, and straight on."""
    radius, turn, at = rng.uniform(0.06, 0.12), rng.uniform(-1.5, 1.5), rng.uniform(-0.03, 0.03)

    def skin(x, y, moment):
        far = np.clip(math.cos(turn) * x + math.sin(turn) * y - at, 0, None)
        return flat(x, y, moment) + round_off(far, radius, 0.6)

    return plain(rng, skin=skin)


def fillet(rng: Generator) -> Outside:
    """A wing's root: a hollow of 50 to 100 mm radius between two flat sides."""
    radius, turn = rng.uniform(0.05, 0.1), rng.uniform(-1.5, 1.5)

    def skin(x, y, moment):
        far = math.cos(turn) * x + math.sin(turn) * y
        return DISTANCE + 0.03 - round_off(far, radius, 0.45)

    return plain(rng, skin=skin)


def saddle(rng: Generator) -> Outside:
    """A fairing that bends one way along and the other way across, by 0.3 m either."""
    turn, bend = rng.uniform(0, math.pi), rng.uniform(0.25, 0.4)

    def skin(x, y, moment):
        a = math.cos(turn) * x + math.sin(turn) * y
        b = math.cos(turn) * y - math.sin(turn) * x
        rise = np.minimum(a * a, 0.05) - np.minimum(b * b, 0.05)
        return flat(x, y, moment) + rise / (2 * bend)

    return plain(rng, skin=skin)


def quilted(rng: Generator) -> Outside:
    """Skin sunk between its frames by 0.2 to 0.5 mm, with ridges over them 120 mm apart."""
    high, pitch, at = rng.uniform(2e-4, 5e-4), rng.uniform(0.09, 0.14), rng.uniform(0, 1)

    def skin(x, y, moment):
        ridges = np.abs(np.sin(np.pi * (x / pitch + at))) * np.abs(np.sin(np.pi * y / 0.2 + 1))
        return flat(x, y, moment) + high * ridges

    return plain(rng, skin=skin)


def joggled(rng: Generator) -> Outside:
    """A skin that steps down by 0.8 to 1.6 mm over 10 to 25 mm, aslant to the fringes."""
    high, wide = rng.uniform(0.8e-3, 1.6e-3), rng.uniform(0.01, 0.025)
    turn, at = rng.uniform(0, math.pi), rng.uniform(-0.02, 0.04)

    def skin(x, y, moment):
        share = np.clip((math.cos(turn) * x + math.sin(turn) * y - at) / wide + 0.5, 0, 1)
        return flat(x, y, moment) + high * share * share * (3 - 2 * share)

    return plain(rng, skin=skin)


def scarfed(rng: Generator) -> Outside:
    """A bonded repair, 1 mm thick and round, whose rim is tapered over 20 to 30 mm."""
    radius, wide = rng.uniform(0.05, 0.07), rng.uniform(0.02, 0.03)
    x0, y0 = rng.uniform(-0.01, 0.04), rng.uniform(-0.02, 0.02)

    def skin(x, y, moment):
        far = (np.hypot(x - x0, y - y0) - radius) / wide
        return flat(x, y, moment) - 0.8e-3 * np.clip(0.5 - far, 0, 1)

    def albedo(place):
        inside = np.hypot(place[:, 0] - x0, place[:, 1] - y0) < radius + wide / 2
        return np.where(inside, 0.55, 0.75)[:, None]

    dimples = three(rng, (-0.15, -0.05), (x0, y0), (-0.14, 0.08))
    return plain(rng, skin=skin, albedo=albedo, dimples=dimples)


def beaded(rng: Generator) -> Outside:
    """A control surface with stiffening beads: ridges 12 mm wide and 1.5 mm high, 60 mm apart."""
    turn, pitch = rng.uniform(0, math.pi), rng.uniform(0.05, 0.07)

    def skin(x, y, moment):
        far = math.cos(turn) * x + math.sin(turn) * y + 0.03
        near = (np.mod(far / pitch + 0.5, 1) - 0.5) * pitch
        return flat(x, y, moment) - 1.5e-3 * np.clip(1 - (near / 0.006) ** 2, 0, None)

    middles = np.arange(-6, 7) * pitch - 0.03
    things = tuple(
        (m * math.cos(turn) - t * math.sin(turn), m * math.sin(turn) + t * math.cos(turn), 0.012)
        for m in middles
        for t in np.arange(-0.4, 0.4, 0.01)
    )
    a, b = middles[5] + pitch / 2, middles[6] + pitch / 2
    places = tuple(
        (m * math.cos(turn) - t * math.sin(turn), m * math.sin(turn) + t * math.cos(turn))
        for m, t in ((a, -0.05), (b, 0.02))
    )
    dimples = tuple(Dimple(*p, 0.025, 0.025, d) for p, d in zip(places, (8e-4, 4e-4), strict=True))
    return plain(rng, skin=skin, dimples=dimples, things=things)


def strut(rng: Generator) -> Outside:
    """A strut of 40 to 60 mm diameter before a wall 0.4 m behind it, a dent on it."""
    radius, turn, at = rng.uniform(0.02, 0.03), rng.uniform(-0.6, 0.6), rng.uniform(-0.03, 0.03)

    def skin(x, y, moment):
        far = math.cos(turn) * x + math.sin(turn) * y - at
        near = np.minimum(np.abs(far), 0.999 * radius)
        tube = DISTANCE - 0.02 + radius - np.sqrt(radius**2 - near**2)
        return np.where(np.abs(far) < 0.999 * radius, tube, DISTANCE + 0.4 + 0.05 * x)

    place = (
        at * math.cos(turn) - 0.03 * math.sin(turn),
        at * math.sin(turn) + 0.03 * math.cos(turn),
    )
    return plain(rng, skin=skin, dimples=(Dimple(*place, 0.02, 0.02, 0.6e-3),))


def slats(rng: Generator) -> Outside:
    """Three panels behind one another by 15 to 40 mm, as slat, wing and flap, edges rounded."""
    steps, turn = rng.uniform(0.015, 0.04, 2), rng.uniform(-0.4, 0.4)

    def skin(x, y, moment):
        far = math.cos(turn) * x + math.sin(turn) * y
        rise = sum(s * (far > a) for s, a in zip(steps, (-0.06, 0.07), strict=True))
        return flat(x, y, moment) - 0.02 + rise

    places = (-0.14, -0.04), (0.0, 0.03), (0.14, 0.05)
    return plain(rng, skin=skin, dimples=three(rng, *places))
