"""Kinds of photographs from outside: light, skins, lenses and sensors that nothing was built on.

`MENDING` may be looked at while the package is changed; `HELD` judges, on fresh seeds, and is
looked at last.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from outside_renderer import DISTANCE, FRINGE, Dimple, Screen, World, flat, photograph, projected
from outside_sensors import (
    bad_lines,
    develop,
    dirt_on_glass,
    drops_on_glass,
    flare,
    fog,
    s_curve,
    smear,
    tilted_focus,
    video,
    vignette,
)
from scipy.spatial import cKDTree

Generator = np.random.Generator


@dataclass(frozen=True, eq=False)
class Outside:
    """A world, and what the camera makes of its light: options of `develop`."""

    world: World
    sensor: dict[str, Any] = field(default_factory=dict)

    def picture(self, rng: Generator) -> NDArray[np.uint8]:
        """Photograph of 8 bits."""
        return develop(photograph(self.world), rng, **self.sensor)


Kind = Callable[[Generator], Outside]


def three(rng: Generator, *places: tuple[float, float]) -> tuple[Dimple, ...]:
    """1.0 mm x 40 mm, 0.5 mm x 50 x 35 mm and 0.25 mm x 25 mm."""
    places = places or ((-0.11, -0.04), (0.10, 0.03), (-0.02, 0.07))
    a, b, c = (np.array(place) + rng.uniform(-0.01, 0.01, 2) for place in places)
    return (
        Dimple(*a, 0.040, 0.040, 1.0e-3),
        Dimple(*b, 0.050, 0.035, 0.5e-3, rng.uniform(0, math.pi)),
        Dimple(*c, 0.025, 0.025, 0.25e-3),
    )


def plain(rng: Generator, sensor: dict[str, Any] | None = None, **options) -> Outside:
    """Dents in a panel, but for the options."""
    options.setdefault('dimples', three(rng))
    return Outside(World(**options), sensor or {})


def of_sensor(**sensor) -> Kind:
    """An ordinary panel, seen by something."""
    return lambda rng: plain(rng, sensor)


# Light


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


# Skins and what is on them


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


# Shapes


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


MENDING: dict[str, Kind] = {
    'plain': plain,
    'dim_corners': dim_corners,
    'lens_dirt': of_sensor(lens=dirt_on_glass),
    'wet': wet,
    'corner_glossy': corner,
    'carbon': carbon,
    'blinds': blinds,
    'mains_flicker': mains_flicker,
    'bad_lines': of_sensor(codec=bad_lines),
    'video': of_sensor(codec=video),
    's_curve': of_sensor(curve=s_curve),
    'tilted_focus': of_sensor(lens=tilted_focus),
    'leading_edge': leading_edge,
    'cable': cable,
    'fasteners': fasteners,
    'at_the_rim': at_the_rim,
    'enormous': enormous,
    'chequers': chequers,
    'laser_line': laser_line,
}

HELD: dict[str, Kind] = {
    'glass_drops': of_sensor(lens=drops_on_glass),
    'frosted': frosted,
    'corner_matt': lambda rng: corner(rng, matt=True),
    'brushed': brushed,
    'window': window,
    'fog': of_sensor(lens=fog(0.5, 0.15)),
    'other_projector': other_projector,
    'strobe': strobe,
    'colour_wheel': colour_wheel,
    'smear_across': of_sensor(lens=smear(5, upright=False)),
    'smear_along': of_sensor(lens=smear(9, upright=True)),
    'steep': steep,
    'hand': hand,
    'bar_code': bar_code,
    'rippled': rippled,
    'bead': bead,
    'fluttering': fluttering,
    'coloured': coloured,
    'flare': of_sensor(lens=flare),
}
