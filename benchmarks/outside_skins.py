"""Kinds of skins that nothing was built on: water, frost, fibres, metal and paint."""

from __future__ import annotations

import math

import cv2
import numpy as np
from outside_panels import Generator, Outside, plain, three
from outside_renderer import FRINGE, projected
from scipy.spatial import cKDTree


def wet(rng: Generator) -> Outside:
    """Drops of water, 2 to 9 mm wide: they bend the light both ways, and shine."""
    count = 60
    x, y = rng.uniform(-0.2, 0.25, count), rng.uniform(-0.15, 0.15, count)
    radius = rng.uniform(0.001, 0.0045, count)
    # A drop of a contact angle of 55 degrees is a cap of a sphere.
    rise = radius * math.tan(math.radians(55) / 2)
    sphere = (radius**2 + rise**2) / (2 * rise)

    nearest = cKDTree(np.stack([x, y], axis=1))

    def cap(place):
        """Height and slopes of the water, metres."""
        _, drop = nearest.query(place)
        away = place - np.stack([x[drop], y[drop]], axis=1)
        square = np.minimum((away * away).sum(axis=1), radius[drop] ** 2)
        root = np.sqrt(sphere[drop] ** 2 - square)
        height = root - sphere[drop] + rise[drop]
        return height, -away / root[:, None]

    def bent(light, height, slopes):
        """How far water moves light that goes along -light to the skin, metres."""
        normal = np.concatenate([-slopes, -np.ones((len(slopes), 1))], axis=1)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        cosine = np.clip(np.einsum('ij,ij->i', light, normal), 0.05, 1)[:, None]
        sine = np.sqrt(1 - cosine**2) / 1.33
        inner = -light / 1.33 + (cosine / 1.33 - np.sqrt(1 - sine**2)) * normal
        return height[:, None] * (inner[:, :2] / inner[:, 2:] + light[:, :2] / -light[:, 2:])

    def bend(world, hits):
        height, slopes = cap(hits.points[:, :2])
        slopes = np.where(height[:, None] > 0, slopes, 0)
        shift = bent(hits.view, height, slopes) - bent(hits.lamp, height, slopes)
        return np.concatenate([shift, np.zeros((len(shift), 1))], axis=1)

    def glints(world, hits):
        height, slopes = cap(hits.points[:, :2])
        normal = np.concatenate([slopes, -np.ones((len(slopes), 1))], axis=1)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        middle = hits.view + hits.lamp
        middle /= np.linalg.norm(middle, axis=1, keepdims=True)
        turn = np.arccos(np.clip(np.einsum('ij,ij->i', middle, normal), -1, 1))
        return (8 * (height > 0) * np.exp(-((turn / 0.03) ** 2)))[:, None] * np.ones(3)

    things = tuple(zip(x, y, radius, strict=True))
    return plain(rng, bend=bend, more=glints, things=things)


def frosted(rng: Generator) -> Outside:
    """Hoar frost in patches: it scatters light by some millimetres within, and is bright."""
    seeds = rng.uniform(-0.2, 0.2, (8, 2)) * (1, 0.6)
    sizes = rng.uniform(0.015, 0.05, 8)

    def share(place):
        far = np.linalg.norm(place[:, None] - seeds, axis=2) / sizes
        return 1 / (1 + np.exp((far.min(axis=1) - 1) / 0.08))

    def albedo(place):
        grain = 0.06 * np.sin(2100 * place[:, 0] + 5) * np.sin(1900 * place[:, 1])
        frost = share(place)
        return (0.5 * (1 - frost) * 0.9 + 0.25 * frost * (1 + grain))[:, None]

    def inside(world, hits):
        # What comes out beside where it went in: the fringes' light, blurred.
        image = world.pattern.draw().astype(np.float32) / 255
        around = projected(cv2.GaussianBlur(image, (0, 0), 3.5), hits.u, hits.v)
        return 0.6 * share(hits.points[:, :2])[:, None] * around

    return plain(rng, albedo=albedo, more=inside)


def carbon(rng: Generator) -> Outside:
    """Carbon fibre under clear lacquer: a twill of tows that shine by their direction."""
    tow, turn = rng.uniform(0.0018, 0.0028), rng.uniform(-0.8, 0.8)
    along, across = (
        np.array([math.cos(turn), math.sin(turn)]),
        np.array([-math.sin(turn), math.cos(turn)]),
    )

    def tows(place):
        i, j = np.floor(place @ along / tow), np.floor(place @ across / tow)
        return np.mod(i + j, 4) < 2

    def shine(world, hits):
        first = tows(hits.points[:, :2])
        middle = hits.view + hits.lamp
        middle /= np.linalg.norm(middle, axis=1, keepdims=True)
        fibre = np.where(first[:, None], along, across)
        sine = np.einsum('ij,ij->i', middle[:, :2], fibre)
        # A fibre shines into a cone about itself.
        image = world.pattern.draw().astype(np.float32) / 255
        return 0.2 * np.exp(-((sine / 0.12) ** 2))[:, None] * projected(image, hits.u, hits.v)

    return plain(
        rng, albedo=lambda place: np.full((len(place), 1), 0.08), more=shine, exposure=2.5
    )


def brushed(rng: Generator) -> Outside:
    """Brushed aluminium: a grain of fine lines, a lobe that is wide across them."""
    turn = rng.uniform(0, math.pi)
    across = np.array([-math.sin(turn), math.cos(turn)])
    grain = cv2.GaussianBlur(rng.normal(0, 1, (1, 4096)).astype(np.float32), (0, 0), 1.0)[0]
    grain *= 0.25 / grain.std()

    def shine(world, hits):
        place = (hits.points[:, :2] @ across) / 0.0004
        line = 1 + np.interp(np.mod(place, 4095), np.arange(4096), grain)
        middle = hits.view + hits.lamp
        middle /= np.linalg.norm(middle, axis=1, keepdims=True)
        slope = middle[:, :2] + hits.normals[:, :2] * -1
        wide, narrow = slope @ across, slope @ (across[1], -across[0])
        lobe = np.exp(-((wide / 0.6) ** 2) - (narrow / 0.22) ** 2) * np.clip(line, 0, None)
        image = world.pattern.draw().astype(np.float32) / 255
        return 0.6 * lobe[:, None] * projected(image, hits.u, hits.v)

    return plain(rng, albedo=lambda place: np.full((len(place), 1), 0.15), more=shine)


def fasteners(rng: Generator) -> Outside:
    """Rows of dark, flush screws a fringe apart."""
    pitch = FRINGE * rng.uniform(0.95, 1.05)

    def albedo(place):
        x = np.mod(place[:, 0] / pitch, 1) - 0.5
        y = np.mod((place[:, 1] + 0.01) / 0.03, 1) - 0.5
        head = np.hypot(x * pitch, y * 0.03) < 0.0013
        return np.where(head, 0.35, 0.75)[:, None]

    return plain(rng, albedo=albedo)


def chequers(rng: Generator) -> Outside:
    """A chequered livery, and a label with bars."""
    size, turn = rng.uniform(0.012, 0.025), rng.uniform(0, 1)

    def albedo(place):
        x = math.cos(turn) * place[:, 0] + math.sin(turn) * place[:, 1]
        y = math.cos(turn) * place[:, 1] - math.sin(turn) * place[:, 0]
        dark = (np.floor(x / size) + np.floor(y / size)) % 2 == 1
        return np.where(dark & (place[:, 0] > 0.02), 0.3, 0.75)[:, None]

    return plain(rng, albedo=albedo)


def bar_code(rng: Generator) -> Outside:
    """A label whose bars are about half a fringe wide, on a dent and beside."""
    edges = np.cumsum(rng.choice([0.5, 1, 1.5, 2], 60) * FRINGE / 2)
    middle = edges[-1] / 2

    def albedo(place):
        number = np.searchsorted(edges, place[:, 0] + 0.05 + middle)
        on = (np.abs(place[:, 0] + 0.05) < 0.06) & (np.abs(place[:, 1] + 0.03) < 0.03)
        return np.where(on & (number % 2 == 1), 0.15, 0.75)[:, None]

    return plain(rng, albedo=albedo)


def coloured(rng: Generator) -> Outside:
    """Red, blue and green paint side by side, as liveries have it."""
    paints = rng.permutation(np.array([[0.6, 0.06, 0.05], [0.05, 0.1, 0.5], [0.1, 0.45, 0.12]]))
    slope = rng.uniform(-0.3, 0.3)

    def albedo(place):
        where = np.digitize(place[:, 0] + slope * place[:, 1], (-0.09, 0.09))
        return paints[where]

    return plain(rng, albedo=albedo)


def wavy_livery(rng: Generator) -> Outside:
    """Blue and white paint with a border in waves, that moves aslant by 1.5 mm in the exposure."""
    at, length, turn = rng.uniform(-0.03, 0.03), rng.uniform(0.02, 0.05), rng.uniform(0, 6)

    def albedo(place):
        x, y = place.T
        blue = x - at > 0.008 * np.sin(2 * math.pi * y / length + turn)
        return np.where(blue[:, None], np.array([[0.08, 0.12, 0.45]]), 0.75)

    way = 0.0015 * np.array([math.cos(turn), math.sin(turn)])
    dimples = three(rng, (-0.11, -0.04), (at, 0.03), (0.1, 0.05))
    return plain(rng, albedo=albedo, dimples=dimples, drift=tuple(way))


def pearl(rng: Generator) -> Outside:
    """Pearlescent paint: flakes whose colour and light go with the angle, in grains of 0.5 mm."""
    grain = rng.normal(0, 1, (512, 512)).astype(np.float32)

    def flakes(world, hits):
        image = world.slide(world.pattern.draw().astype(np.float32) / 255)
        column, row = np.mod(np.floor(hits.points[:, :2].T / 0.0005).astype(int), 512)
        turn = np.arccos(hits.half())
        colour = 0.5 + 0.5 * np.cos(9 * turn[:, None] + np.array([0, 2.1, 4.2]))
        lobe = 0.5 * np.exp(-((turn / 0.35) ** 2)) * np.clip(1 + 0.3 * grain[row, column], 0, 3)
        return lobe[:, None] * colour * projected(image, hits.u, hits.v)

    return plain(rng, albedo=lambda place: np.full((len(place), 1), 0.3), more=flakes)


def polished(rng: Generator) -> Outside:
    """Polished bare metal that mirrors rows of a hangar's lamps, as far apart as fringes seem."""
    pitch, turn = rng.uniform(0.02, 0.04), rng.uniform(-0.5, 0.5)

    def lamps(world, hits):
        cosine = np.einsum('ij,ij->i', hits.view, hits.normals)[:, None]
        way = 2 * cosine * hits.normals - hits.view
        # Tubes on a ceiling 3 m behind the camera, by the directions they are seen in.
        across = way[:, 0] / -way[:, 2] + turn * way[:, 1] / -way[:, 2]
        on = np.clip(2.5 * np.cos(2 * math.pi * across / pitch) - 1.3, 0, 1)
        within = np.hypot(hits.points[:, 0] - 0.06, hits.points[:, 1]) < 0.07
        return (0.5 * on * within)[:, None] * np.ones(3)

    def albedo(place):
        within = np.hypot(place[:, 0] - 0.06, place[:, 1]) < 0.07
        return np.where(within, 0.12, 0.75)[:, None]

    return plain(rng, albedo=albedo, more=lamps)


def insects(rng: Generator) -> Outside:
    """Insects and oil on a leading edge: dark spots of 2 to 6 mm, tails to the right."""
    x, y = rng.uniform(-0.2, 0.2, 25), rng.uniform(-0.12, 0.12, 25)
    radius, tail = rng.uniform(0.001, 0.003, 25), rng.uniform(0.01, 0.05, 25)

    def albedo(place):
        grey = np.full(len(place), 0.75)
        for a, b, r, t in zip(x, y, radius, tail, strict=True):
            away = np.stack([place[:, 0] - a, place[:, 1] - b])
            grey = np.where(np.hypot(*away) < r, 0.15, grey)
            behind = np.clip(away[0] / t, 0, 1)
            streak = (away[0] > 0) * np.exp(-((away[1] / r) ** 2)) * (1 - behind)
            grey = grey * (1 - 0.4 * streak)
        return grey[:, None]

    return plain(rng, albedo=albedo)
