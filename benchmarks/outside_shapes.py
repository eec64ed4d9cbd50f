"""Kinds of shapes that nothing was built on, and what stands before the skin."""

from __future__ import annotations

import math

import numpy as np
from outside_panels import Generator, Outside, plain, three
from outside_parts import Dimple, Screen
from outside_renderer import DISTANCE, flat, projected


def corner(rng: Generator, matt: bool = False) -> Outside:
    """A concave corner, as at a wing's root: the one side lights the other, or mirrors it."""
    slope = rng.uniform(0.7, 0.9)

    def skin(x, y, moment):
        # A fillet of some millimetres.
        return DISTANCE + 0.05 - slope * np.sqrt(x * x + 0.006**2)

    def mirrored(world, hits):
        """Lacquer's mirror image of the other side."""
        way = (
            2 * np.einsum('ij,ij->i', hits.view, hits.normals)[:, None] * hits.normals - hits.view
        )
        side = np.sign(hits.points[:, 0])
        # The other side is the plane z = DISTANCE + 0.05 + slope side x.
        rise = way[:, 2] - slope * side * way[:, 0]
        reach = (DISTANCE + 0.05 + slope * side * hits.points[:, 0] - hits.points[:, 2]) / rise
        there = hits.points + np.clip(reach, 0, 0.6)[:, None] * way
        met = (reach > 0.001) & (there[:, 0] * side < 0) & (reach < 0.6)
        normals = world.normals(there)
        other = world.hits(there, normals, hits.rows, hits.moment)
        image = world.pattern.draw().astype(np.float32) / 255
        facing = np.clip(np.einsum('ij,ij->i', normals, other.lamp), 0, None)
        cosine = np.clip(np.einsum('ij,ij->i', hits.view, hits.normals), 0, 1)
        fresnel = 0.05 + 0.95 * (1 - cosine) ** 5
        return (fresnel * met * facing * 0.75)[:, None] * projected(image, other.u, other.v)

    def scattered(world, hits):
        """What the other side's white paint sends over, by the cosines of both."""
        far = np.abs(hits.points[:, 0])
        return (0.25 / (1 + (far / 0.08) ** 2))[:, None] * np.ones(3)

    dimples = three(rng, (-0.11, -0.04), (0.10, 0.03), (-0.12, 0.07))
    return plain(rng, skin=skin, dimples=dimples, more=scattered if matt else mirrored)


def leading_edge(rng: Generator) -> Outside:
    """A wing's leading edge of 0.15 m radius, upright or aslant."""
    radius, turn = 0.15, rng.uniform(-0.4, 0.4)
    most = radius * math.sin(math.radians(70))

    def skin(x, y, moment):
        far = np.abs(math.cos(turn) * x + math.sin(turn) * y)
        near = np.minimum(far, most)
        depth = radius - np.sqrt(radius**2 - near**2)
        return DISTANCE - 0.03 + depth + (far - near) * math.tan(math.radians(70))

    return plain(rng, skin=skin, dimples=three(rng, (-0.05, -0.04), (0.04, 0.03), (-0.02, 0.08)))


def steep(rng: Generator) -> Outside:
    """A panel turned by 55 to 60 degrees away from the projector's side."""
    slope = math.tan(math.radians(rng.uniform(52, 60))) * rng.choice([-1, 1])
    return plain(rng, skin=lambda x, y, moment: DISTANCE + slope * x + 0.02 * y)


def cable(rng: Generator) -> Outside:
    """A cable and an antenna before the skin."""
    slope, at = rng.uniform(-0.5, 0.5), rng.uniform(-0.03, 0.03)
    screens = (
        Screen(0.6, lambda x, y: np.abs(y - slope * x - at) < 0.002, 0.3),
        Screen(0.74, lambda x, y: (np.abs(x - 0.03) < 0.006) & (y > 0.02), 0.6),
    )
    return plain(rng, screens=screens)


def hand(rng: Generator) -> Outside:
    """A hand that points at a dent."""
    fingers = np.linspace(-0.05, 0.05, 5)
    lengths = np.array([0.05, 0.02, 0.03, 0.035, 0.05])

    def covers(x, y):
        palm = np.hypot(x - 0.15, (y - 0.11) / 1.2) < 0.05
        for offset, top in zip(fingers, lengths, strict=True):
            palm |= (np.abs(x - 0.15 - 0.8 * offset) < 0.009) & (y > top) & (y < 0.11)
        return palm

    return plain(rng, screens=(Screen(0.68, covers, 0.45),))


def at_the_rim(rng: Generator) -> Outside:
    """Dents that the picture's rim and the light's cut, and one just inside."""
    dimples = (
        Dimple(-0.26, rng.uniform(-0.08, 0.0), 0.05, 0.05, 0.0008),
        Dimple(rng.uniform(-0.1, 0.0), 0.148, 0.04, 0.04, 0.0006),
        Dimple(0.22, rng.uniform(0.0, 0.06), 0.03, 0.03, 0.0005),
        Dimple(-0.1, -0.125, 0.03, 0.03, 0.0005),
    )
    return plain(rng, dimples=dimples)


def enormous(rng: Generator) -> Outside:
    """A dent half as wide as the view, and one of 10 mm."""
    dimples = (
        Dimple(-0.08, 0.0, 0.25, 0.2, rng.uniform(0.002, 0.004)),
        Dimple(0.14, 0.02, 0.08, 0.08, 0.010),
    )
    return plain(rng, dimples=dimples)


def rippled(rng: Generator) -> Outside:
    """Skin that is buckled in waves of 25 to 50 mm, 0.1 mm high, under the dents."""
    length, turn = rng.uniform(0.025, 0.05), rng.uniform(0, math.pi)

    def skin(x, y, moment):
        phase = (math.cos(turn) * x + math.sin(turn) * y) * 2 * math.pi / length
        return flat(x, y, moment) + 1e-4 * np.sin(phase)

    return plain(rng, skin=skin)


def fluttering(rng: Generator) -> Outside:
    """Skin that moves by half a millimetre to and from the camera in the exposure."""
    way = rng.uniform(0.3e-3, 0.8e-3)
    return plain(rng, skin=lambda x, y, moment: flat(x, y, moment) + way * moment)


def window(rng: Generator) -> Outside:
    """A cabin's window: the pane mirrors little, and the fringes fall on the wall behind."""
    x0, y0 = rng.uniform(0.02, 0.08), rng.uniform(-0.04, 0.02)

    def inside(x, y):
        return (np.abs((x - x0) / 0.06) ** 4 + np.abs((y - y0) / 0.08) ** 4) < 1

    def skin(x, y, moment):
        return flat(x, y, moment) + np.where(inside(x, y), 0.035, 0.0)

    def albedo(place):
        return np.where(inside(place[:, 0], place[:, 1]), 0.45, 0.75)[:, None]

    return plain(
        rng,
        skin=skin,
        albedo=albedo,
        dimples=three(rng, (-0.15, -0.04), (-0.12, 0.06), (-0.05, 0.1)),
    )


def bead(rng: Generator) -> Outside:
    """Sealant over a seam: a bead 1 mm high, 8 mm wide, greyer than the skin, wavy edges."""
    turn, at = rng.uniform(-0.3, 0.3), rng.uniform(0.0, 0.04)

    def off(x, y):
        return (x - at + turn * y + 0.0008 * np.sin(900 * y)) / 0.004

    def skin(x, y, moment):
        return flat(x, y, moment) - 0.001 * np.clip(1 - off(x, y) ** 2, 0, None)

    def albedo(place):
        on = np.abs(off(place[:, 0], place[:, 1])) < 1
        return np.where(on, 0.5, 0.75)[:, None]

    return plain(rng, skin=skin, albedo=albedo)


def behind(rng: Generator) -> Outside:
    """A wing's round tip over half of the view, and another aircraft 0.5 m behind it."""
    at, slope, gap = rng.uniform(-0.02, 0.05), rng.uniform(-0.3, 0.3), rng.uniform(0.3, 0.6)

    def skin(x, y, moment):
        # The tip bends back like a quarter of a tube of 20 mm.
        far = np.clip(x - at - slope * y, 0, 0.0199)
        tip = flat(x, y, moment) + 0.02 - np.sqrt(0.02**2 - far**2)
        beyond = x - at - slope * y > 0.0199
        return np.where(beyond, DISTANCE + gap + 0.1 * x, tip)

    dimples = three(rng, (-0.15, -0.05), (-0.1, 0.03), (-0.18, 0.08))
    return plain(rng, skin=skin, dimples=dimples)


def off_aircraft(rng: Generator) -> Outside:
    """A trailing edge across the view: half of the fringes fall into the dark beyond it."""
    turn, at = rng.uniform(0.3, 1.2), rng.uniform(-0.02, 0.03)

    def skin(x, y, moment):
        beyond = math.cos(turn) * x + math.sin(turn) * y > at
        return np.where(beyond, 8.0, flat(x, y, moment))

    dimples = three(rng, (-0.12, -0.04), (-0.04, -0.03), (-0.18, 0.05))
    return plain(rng, skin=skin, dimples=dimples)


def frame_shadow(rng: Generator) -> Outside:
    """A scaffold's tube before the projector alone: its shadow on a fuselage of 0.4 m radius."""
    slope = rng.uniform(-0.4, 0.4)

    def skin(x, y, moment):
        away = np.clip(0.2 * x + y, -0.35, 0.35)
        return DISTANCE - 0.02 + 0.4 - np.sqrt(0.4**2 - away**2)

    def tube(x, y):
        # Between projector and skin, out of the camera's view.
        return np.abs(y - slope * (x - 0.15) - 0.005) < 0.006

    dimples = three(rng, (-0.10, -0.06), (0.08, 0.04), (0.0, 0.0))
    return plain(rng, skin=skin, dimples=dimples, screens=(Screen(0.25, tube, 0.3),))


def honeycomb(rng: Generator) -> Outside:
    """Cells of 9 mm that print through a thin skin, 30 um deep."""
    turn, pitch = rng.uniform(0, 1), 0.009

    def skin(x, y, moment):
        angles = turn + np.arange(3) * math.pi / 3
        waves = sum(
            np.cos(2 * math.pi * (math.cos(a) * x + math.sin(a) * y) / (pitch * 0.866))
            for a in angles
        )
        return flat(x, y, moment) + 1e-5 * waves

    return plain(rng, skin=skin)


def oil_can(rng: Generator) -> Outside:
    """A panel that has popped in: 0.45 m wide and 2 to 4 mm deep, over the whole view."""
    dimples = (
        Dimple(0.02, 0.0, 0.45, 0.35, rng.uniform(0.002, 0.004), rng.uniform(0, 1)),
        *three(rng),
    )
    return plain(rng, dimples=dimples)


def steep_crease(rng: Generator) -> Outside:
    """A fold: flanks of 35 to 45 degrees, 1.2 mm deep, 120 mm long, a sharp bottom."""
    turn, slope = rng.uniform(-0.6, 0.6), math.tan(math.radians(rng.uniform(35, 45)))

    def skin(x, y, moment):
        across = math.cos(turn) * x + math.sin(turn) * y
        along = math.cos(turn) * y - math.sin(turn) * x
        depth = 0.0012 * np.clip(1 - (along / 0.06) ** 2, 0, 1)
        return flat(x, y, moment) + np.clip(depth - slope * np.abs(across), 0, None)

    things = tuple(
        (-0.01 * k * math.sin(turn), 0.01 * k * math.cos(turn), 0.012) for k in range(-6, 7)
    )
    places = (-0.13, -0.04), (0.12, 0.03), (-0.10, 0.07)
    return plain(rng, skin=skin, dimples=three(rng, *places), things=things)
