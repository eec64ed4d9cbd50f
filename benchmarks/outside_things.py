"""Kinds with things on the skin or before it, or that move, that nothing was built on."""

from __future__ import annotations

import math

import cv2
import numpy as np
from outside_panels import Generator, Outside, plain, three
from outside_parts import Screen
from outside_renderer import DISTANCE, flat, projected

_WHITE = 0.75


def ring(x, y, x0: float, y0: float, radius: float, width: float):
    """Whether places are on a ring's line."""
    return np.abs(np.hypot(x - x0, y - y0) - radius) < width / 2


def circled(rng: Generator) -> Outside:
    """Dents that somebody has found before: a line of grease pencil around, a number beside."""
    dimples = three(rng)
    text = np.zeros((600, 1000), np.uint8)
    for number, dimple in enumerate(dimples):
        beside = dimple.y + dimple.length / 2 + 0.02
        place = (int(500 + 2000 * dimple.x) - 20, int(300 + 2000 * beside))
        cv2.putText(text, str(24 + 13 * number), place, cv2.FONT_HERSHEY_SIMPLEX, 1.2, 255, 4)
    wobble = rng.uniform(0, 6, len(dimples))

    def albedo(place):
        x, y = place.T
        on = np.zeros(len(place), bool)
        for dimple, shift in zip(dimples, wobble, strict=True):
            turn = np.arctan2(y - dimple.y, x - dimple.x)
            radius = (dimple.length / 2 + 0.004) * (1 + 0.06 * np.sin(2 * turn + shift))
            on |= ring(x, y, dimple.x, dimple.y, radius, 0.002)
        column = np.clip((500 + 2000 * x).astype(int), 0, 999)
        row = np.clip((300 + 2000 * y).astype(int), 0, 599)
        return np.where(on | (text[row, column] > 127), 0.2, _WHITE)[:, None]

    return plain(rng, dimples=dimples, albedo=albedo)


def stickers(rng: Generator) -> Outside:
    """Paper dots, white and dark, 0.1 mm thick, beside the dents and on one."""
    x, y = rng.uniform(-0.2, 0.2, 9), rng.uniform(-0.1, 0.1, 9)
    dark = rng.random(9) < 0.5
    dimples = three(rng)
    x[0], y[0] = dimples[0].x + 0.012, dimples[0].y

    def on(places_x, places_y):
        return [np.hypot(places_x - a, places_y - b) < 0.009 for a, b in zip(x, y, strict=True)]

    def skin(places_x, places_y, moment):
        return flat(places_x, places_y, moment) - 1e-4 * np.any(on(places_x, places_y), axis=0)

    def albedo(place):
        grey = np.full(len(place), 0.5)
        for mask, each in zip(on(*place.T), dark, strict=True):
            grey = np.where(mask, 0.12 if each else 0.85, grey)
        return grey[:, None]

    return plain(rng, dimples=dimples, skin=skin, albedo=albedo)


def speed_tape(rng: Generator) -> Outside:
    """A strip of aluminium tape, 0.1 mm thick and 50 mm wide, shiny, with wrinkles."""
    turn, at = rng.uniform(-0.4, 0.4), rng.uniform(-0.02, 0.05)
    shift = rng.uniform(0, 6, 3)

    def off(x, y):
        return (math.cos(turn) * (x - at) + math.sin(turn) * y) / 0.025

    def skin(x, y, moment):
        along = math.cos(turn) * y - math.sin(turn) * (x - at)
        wrinkles = sum(
            3e-5 * np.exp(-(((along - 0.03 * k + 0.03) / 0.002) ** 2)) * np.sin(90 * x + s)
            for k, s in enumerate(shift)
        )
        return flat(x, y, moment) - (1e-4 + wrinkles) * (np.abs(off(x, y)) < 1)

    def shine(world, hits):
        image = world.slide(world.pattern.draw().astype(np.float32) / 255)
        on = np.abs(off(*hits.points[:, :2].T)) < 1
        lobe = np.exp(-((np.arccos(hits.half()) / 0.25) ** 2))
        return (0.9 * on * lobe)[:, None] * projected(image, hits.u, hits.v)

    def albedo(place):
        return np.where(np.abs(off(*place.T)) < 1, 0.22, _WHITE)[:, None]

    return plain(rng, skin=skin, albedo=albedo, more=shine)


def door_seal(rng: Generator) -> Outside:
    """A door's edge: a black rubber seal 9 mm wide, 1.5 mm deep, around rounded corners."""
    x0, y0 = rng.uniform(0.0, 0.05), rng.uniform(-0.02, 0.03)

    def off(x, y):
        far_x, far_y = np.abs(x - x0) - 0.07, np.abs(y - y0) - 0.04
        return np.abs(np.hypot(np.maximum(far_x, 0), np.maximum(far_y, 0)) - 0.03) / 0.0045

    def skin(x, y, moment):
        return flat(x, y, moment) + 0.0015 * np.clip(2 - 2 * off(x, y), 0, 1)

    def albedo(place):
        return np.where(off(*place.T) < 1, 0.04, _WHITE)[:, None]

    places = (-0.15, -0.04), (x0, y0), (-0.16, 0.07)
    return plain(rng, skin=skin, albedo=albedo, dimples=three(rng, *places))


def static_port(rng: Generator) -> Outside:
    """A plate of bare metal with six holes, flush, in a ring of red paint, beside a dent."""
    x0, y0 = rng.uniform(-0.02, 0.04), rng.uniform(-0.03, 0.03)
    turns = np.arange(6) * math.pi / 3

    def hole(x, y):
        holes = [
            np.hypot(x - x0 - 0.009 * np.cos(a), y - y0 - 0.009 * np.sin(a)) < 0.0012
            for a in turns
        ]
        return np.any(holes, axis=0)

    def skin(x, y, moment):
        return flat(x, y, moment) + 0.006 * hole(x, y)

    def albedo(place):
        x, y = place.T
        grey = np.full((len(place), 3), _WHITE)
        grey[ring(x, y, x0, y0, 0.034, 0.008)] = 0.6, 0.06, 0.05
        grey[np.hypot(x - x0, y - y0) < 0.022] = 0.35
        grey[hole(x, y)] = 0.03
        return grey

    places = (-0.12, -0.04), (x0 + 0.07, y0), (x0 - 0.03, y0 + 0.07)
    things = ((x0, y0, 0.012),)
    return plain(rng, skin=skin, albedo=albedo, dimples=three(rng, *places), things=things)


def antenna(rng: Generator) -> Outside:
    """An antenna's blade on an oval base 4 mm high, with its shadow, near a dent."""
    x0, y0 = rng.uniform(0.0, 0.06), rng.uniform(-0.03, 0.03)

    def skin(x, y, moment):
        away = np.hypot((x - x0) / 0.02, (y - y0) / 0.05)
        base = 0.004 * np.clip((1 - away) / 0.08, 0, 1)
        # Flanks that no ray of this renderer misses.
        blade = 0.03 * np.clip((1 - np.hypot((x - x0) / 0.006, (y - y0) / 0.035)) / 0.7, 0, 1)
        return flat(x, y, moment) - np.maximum(base, blade)

    places = (-0.12, -0.04), (x0 - 0.06, y0 + 0.02), (x0 + 0.1, y0 + 0.05)
    things = tuple((x0, y0 + 0.0125 * k, 0.022) for k in range(-3, 4))
    return plain(rng, skin=skin, dimples=three(rng, *places), things=things)


def scalloped(rng: Generator) -> Outside:
    """A repair patch 0.8 mm thick, greyer than the skin, its edge in waves between the rivets."""
    x0, y0, waves = rng.uniform(0.02, 0.06), rng.uniform(-0.02, 0.02), rng.integers(9, 16)

    def off(x, y):
        turn = np.arctan2(y - y0, x - x0)
        return np.hypot(x - x0, y - y0) / (0.055 * (1 + 0.06 * np.cos(waves * turn)))

    def skin(x, y, moment):
        return flat(x, y, moment) - 0.0008 * (off(x, y) < 1)

    def albedo(place):
        x, y = place.T
        turn = np.arctan2(y - y0, x - x0)
        near = 0.05 * np.mod(turn * waves / (2 * math.pi) + 0.5, 1) - 0.025
        head = np.hypot(near * 2 * math.pi / waves, np.hypot(x - x0, y - y0) - 0.047) < 0.002
        return np.where(off(x, y) < 1, np.where(head, 0.3, 0.55), _WHITE)[:, None]

    places = (-0.13, -0.04), (x0, y0), (-0.1, 0.07)
    things = ((x0, y0, 0.06),)
    return plain(rng, skin=skin, albedo=albedo, dimples=three(rng, *places), things=things)


def net(rng: Generator) -> Outside:
    """A safety net 0.1 m before the skin: cords of 1.5 mm, meshes of 45 mm, and their shadows."""
    turn, pitch = rng.uniform(0.5, 1.0), 0.045

    def cords(x, y):
        along = math.cos(turn) * x + math.sin(turn) * y
        across = math.cos(turn) * y - math.sin(turn) * x
        sag = 0.004 * np.sin(x / 0.03)
        far = [np.abs(np.mod((a + sag) / pitch, 1) - 0.5) * pitch for a in (along, across)]
        return np.minimum(*far) < 0.00075

    return plain(rng, screens=(Screen(DISTANCE - 0.1, cords, 0.6),))


def rivets_in_dent(rng: Generator) -> Outside:
    """Dents across a row of domed rivets, 5 mm wide and 0.7 mm high, each in its own dimple."""
    at, pitch = rng.uniform(-0.02, 0.02), 0.022
    dimples = three(rng, (-0.11, at), (0.10, at), (0.0, at))

    def off(x, y):
        return np.hypot(np.mod(x / pitch, 1) * pitch - pitch / 2, y - at)

    def skin(x, y, moment):
        head = 0.0007 * np.clip(1 - (off(x, y) / 0.0025) ** 2, 0, 1)
        pulled = 0.0001 * np.exp(-((off(x, y) / 0.006) ** 2))
        return flat(x, y, moment) + pulled - head

    columns = (np.arange(-12, 13) + 0.5) * pitch
    things = tuple((float(x), at, 0.006) for x in columns)
    return plain(rng, dimples=dimples, skin=skin, things=things)


def sealed_dent(rng: Generator) -> Outside:
    """A bead of grey sealant, 1 mm high and 8 mm wide, straight through two dents."""
    turn, dimples = rng.uniform(-0.2, 0.2), three(rng, (0.0, -0.05), (0.0, 0.05), (-0.12, 0.02))
    at = (dimples[0].x + dimples[1].x) / 2

    def off(x, y):
        return (x - at + turn * y) / 0.004

    def skin(x, y, moment):
        return flat(x, y, moment) - 0.001 * np.clip(1 - off(x, y) ** 2, 0, None)

    def albedo(place):
        return np.where(np.abs(off(*place.T)) < 1, 0.5, _WHITE)[:, None]

    return plain(rng, dimples=dimples, skin=skin, albedo=albedo)


def lapped_dent(rng: Generator) -> Outside:
    """Dents through a lap of 1.2 mm, whose edge is aslant to the fringes."""
    turn = rng.uniform(-0.7, 0.7)
    dimples = three(rng, (0.0, -0.05), (0.02, 0.05), (-0.14, 0.0))

    def skin(x, y, moment):
        beyond = math.cos(turn) * (x - 0.01) + math.sin(turn) * y > 0
        return flat(x, y, moment) + 0.0012 * beyond

    return plain(rng, dimples=dimples, skin=skin)


def rolling(rng: Generator) -> Outside:
    """Yaw past lettering, by a rolling shutter: 2 mm aslant and 0.2 mm to the camera a picture."""
    way = 0.002 * np.array([1.0, rng.uniform(-0.7, 0.7)]) * rng.choice([-1, 1])
    near, size = rng.uniform(-5e-5, 5e-5), rng.uniform(0.015, 0.03)

    def skin(x, y, moment):
        return flat(x, y, moment) + near * moment

    def albedo(place):
        x, y = place.T
        dark = (np.floor(x / size) + np.floor(y / 0.03)) % 3 == 0
        return np.where(dark, 0.3, _WHITE)[:, None]

    return plain(rng, skin=skin, albedo=albedo, drift=tuple(way / 4), readout=4.0)


def shaken(rng: Generator) -> Outside:
    """A drone that shakes by 0.1 mm, four times while its rolling shutter reads a picture."""
    shift = rng.uniform(0, 6)

    def skin(x, y, moment):
        return flat(x, y, moment) + 1e-4 * np.sin(8 * math.pi * moment / 40 + shift)

    return plain(rng, skin=skin, readout=40.0)
