"""Scenes of every kind of skin, light and sensor: what a reconstruction must not fall for.

Each kind is a function of a random generator; `scene_of` turns it into a photograph to take.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.evaluation.scenes import make_rig
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.photograph.photograph import Photograph
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.rig.rig import Rig
from ftp_dent_ros.simulation import (
    Bead,
    Dent,
    Dirt,
    DomedRivet,
    Lettering,
    MissingRivet,
    Motion,
    Opening,
    Paint,
    Panel,
    Patch,
    Photometry,
    Renderer,
    Rivet,
    Sunlight,
    Surface,
    scratches,
    waviness,
)
from ftp_dent_ros.simulation.dents import SMOOTH, Gaussian, Shape
from ftp_dent_ros.simulation.fittings import Fitting
from ftp_dent_ros.simulation.ground_truth import GroundTruth, ground_truth

CAMERA = 1280, 720, 1700.0
PATTERN = Pattern(1280, 720, 10.0, 640.0)
# The skin in view at 0.8 m, metres.
VIEW = (-0.22, 0.22, -0.12, 0.12)
_OUT = (-2.0, 2.0, -2.0, 2.0)


@dataclass(frozen=True, eq=False)
class KindScene:
    """One photograph of a kind."""

    rig: Rig
    panels: tuple[Panel, ...]
    photometry: Photometry
    pattern: Pattern = PATTERN
    motion: Motion = field(default_factory=Motion)

    @property
    def surface(self) -> Surface:
        """The panels together."""
        return Surface(self.panels)

    @property
    def bare(self) -> Surface:
        """The same without dents."""
        return Surface(tuple(replace(panel, dents=()) for panel in self.panels))

    def renderer(self) -> Renderer:
        """Of its rig, pattern and light."""
        return Renderer(self.rig, self.pattern.draw(), self.photometry)

    def photograph(self, seed: int = 0) -> NDArray[np.uint8]:
        """Render it with the noise of a seed, as 8 bits of three colours."""
        return self.taken(seed).shown()

    def taken(self, seed: int = 0) -> Photograph:
        """Render it with the noise of a seed, in the camera's encoding."""
        rng = np.random.default_rng([seed, 77])
        return self.renderer().photograph(self.surface, rng, self.motion)

    def truth(self, stride: int = 1) -> GroundTruth:
        """What its pixels show."""
        return ground_truth(
            self.renderer(), self.surface, self.pattern.period_px, stride, self.motion
        )


Kind = Callable[[np.random.Generator], KindScene]
RIG = make_rig(0.8, 0.24, CAMERA, 1890.0)


def by_contour(x, y, length, width, depth, angle=0.0, shape: Shape = SMOOTH) -> Dent:
    """A dent whose 10 % contour has these sizes, metres."""
    part, _ = Dent(0, 0, 1, 1, 1, 0, shape).size_at(0.1)
    return Dent(x, y, length / part, width / part, depth, angle, shape)


def three_dents(rng: np.random.Generator, *places: tuple[float, float]) -> tuple[Dent, ...]:
    """1.0 mm x 40 mm, 0.5 mm x 60 x 35 mm and 0.25 mm x 25 mm, at places or where they fit."""
    places = places or ((-0.08, -0.035), (0.07, 0.03), (-0.02, 0.075))
    (a, b, c) = (np.array(place) + rng.uniform(-0.008, 0.008, 2) for place in places)
    return (
        by_contour(*a, 0.040, 0.040, 0.001),
        by_contour(*b, 0.060, 0.035, 0.0005, rng.uniform(0, math.pi)),
        by_contour(*c, 0.025, 0.025, 0.00025, 0.0, Gaussian()),
    )


def hail(rng: np.random.Generator, count: int, least: float = 0.1e-3) -> tuple[Dent, ...]:
    """Gaussian dents of 10 to 25 mm, `least` to 0.6 mm deep, apart from one another."""
    dents: list[Dent] = []
    while len(dents) < count:
        x, y = rng.uniform(-0.17, 0.15), rng.uniform(-0.075, 0.075)
        size = rng.uniform(0.010, 0.025)
        if all(math.hypot(x - d.x, y - d.y) > (size + d.length) * 0.75 for d in dents):
            depth = float(np.exp(rng.uniform(math.log(least), math.log(0.6e-3))))
            dents.append(by_contour(x, y, size, size * rng.uniform(0.85, 1), depth, 0, Gaussian()))
    return tuple(dents)


def skin(rng: np.random.Generator, distance: float = 0.8, spread: float = 3.0, **options) -> Panel:
    """A panel that fills the frame, tilted by a few degrees."""
    tilt = np.radians(rng.uniform(-spread, spread, 2))
    pose = Pose.from_rpy((*tilt, math.radians(rng.uniform(-2, 2))), (0, 0, distance))
    options.setdefault('dents', three_dents(rng))
    return Panel(pose, _OUT, **options)


def light(**options) -> Photometry:
    """A lamp that gives a white skin 85 % of saturation, and some daylight."""
    return Photometry(**{'exposure': 1.0, 'ambient': 0.03, 'samples': 8, **options})


def scene(panel: Panel, *more: Panel, rig: Rig = RIG, motion: Motion | None = None, **options):
    """Photograph of panels."""
    pattern = options.pop('pattern', PATTERN)
    distance = float(panel.pose.translation[2])
    photometry = light(**{'reference_distance': distance, **options})
    return KindScene(rig, (panel, *more), photometry, pattern, motion or Motion())


def marked(rng: np.random.Generator, *marks, **options) -> KindScene:
    """Skin with marks."""
    return scene(skin(rng, paint=Paint(marks=marks)), **options)


def seed(rng: np.random.Generator) -> int:
    """A seed of marks."""
    return int(rng.integers(1 << 30))


def across_edge(rng: np.random.Generator) -> tuple[tuple[float, float, float], tuple[Dent, ...]]:
    """An edge through the middle of three dents, upright to aslant, and the dents on it."""
    angle = math.radians(rng.uniform(-35, 35))
    offset = rng.uniform(-0.03, 0.05)
    along = np.array([-math.sin(angle), math.cos(angle)])
    normal = np.array([math.cos(angle), math.sin(angle)])
    places = tuple(
        tuple(offset * normal + t * along + rng.uniform(-0.004, 0.004, 2))
        for t in (-0.06, 0.0, 0.06)
    )
    dents = (
        by_contour(*places[1], 0.040, 0.040, 0.001),
        by_contour(*places[2], 0.030, 0.030, 0.0005, 0.0, Gaussian()),
        by_contour(*places[0], 0.025, 0.025, 0.00025, 0.0, Gaussian()),
        by_contour(-0.13, rng.uniform(-0.05, 0.05), 0.025, 0.025, 0.00025, 0.0, Gaussian()),
    )
    return (float(normal[0]), float(normal[1]), float(offset)), dents


def sunny(rng: np.random.Generator, softness: float) -> KindScene:
    """The edge of a shadow across dents."""
    edge, dents = across_edge(rng)
    sun = Sunlight(rng.uniform(0.6, 1.1), edge, softness)
    return scene(skin(rng, dents=dents, sunlight=(sun,)), exposure=0.48)


def painted(rng: np.random.Generator) -> KindScene:
    """The edge of a paint across dents."""
    edge, dents = across_edge(rng)
    tone = rng.uniform(0.2, 0.45)
    paint = Paint((0.75,) * 3, edge, (tone, tone * 0.95, tone * 1.05))
    return scene(skin(rng, dents=dents, paint=paint))


def lettered(rng: np.random.Generator) -> KindScene:
    """Letters of three sizes, one line through the dents."""
    dents = three_dents(rng)
    tint = rng.uniform(0.08, 0.4)
    marks = (
        Lettering(dents[0].x + 0.02, dents[0].y, 'NO STEP', 0.03, (tint,) * 3),
        Lettering(dents[1].x - 0.01, dents[1].y, 'G-FTPD 017', 0.02, (tint, tint, 0.5), 0.02),
        Lettering(dents[2].x + 0.03, dents[2].y, 'STATIC PORT - KEEP CLEAR', 0.006, (0.2,) * 3),
        Lettering(0.1, -0.09, 'HOIST POINT 4', 0.012, (0.7, 0.12, 0.12), -0.01),
    )
    return scene(skin(rng, dents=dents, paint=Paint(marks=marks)))


def patched(rng: np.random.Generator) -> KindScene:
    """Repairs: patches of other paints, round and square, light and dark, some on dents."""
    dents = three_dents(rng)
    marks = tuple(
        Patch(
            *(rng.uniform(-0.15, 0.15), rng.uniform(-0.09, 0.09)),
            rng.uniform(0.02, 0.08),
            rng.uniform(0.01, 0.05),
            tuple(rng.uniform(0.3, 1.2) * rng.uniform(0.9, 1.0, 3)),
            rng.uniform(0, 3),
            bool(rng.integers(2)),
        )
        for _ in range(6)
    )
    half_on = Patch(dents[1].x + 0.02, dents[1].y, 0.04, 0.06, (0.5,) * 3)
    return scene(skin(rng, dents=dents, paint=Paint(marks=(*marks, half_on))))


def scratched(rng: np.random.Generator) -> KindScene:
    """Scratches all over, and two through the first dent."""
    dents = three_dents(rng)
    through = tuple(
        Patch(dents[0].x, dents[0].y, 0.07, 0.0006, (tint,) * 3, rng.uniform(0, math.pi))
        for tint in (0.35, 1.2)
    )
    return scene(
        skin(rng, dents=dents, paint=Paint(marks=(*scratches(16, VIEW, seed(rng)), *through)))
    )


def dirty(contrast: float) -> Kind:
    """Dirt of scales from 64 mm down to 4 mm."""

    def kind(rng: np.random.Generator) -> KindScene:
        return marked(rng, Dirt(contrast, seed=seed(rng)))

    return kind


def streaked(angle: float) -> Kind:
    """Streaks 3 to 12 mm wide."""

    def kind(rng: np.random.Generator) -> KindScene:
        turn = angle + math.radians(rng.uniform(-4, 4))
        dirt = Dirt(0.2, (0.012, 0.003), seed(rng), stretch=25, angle=turn)
        return marked(rng, dirt)

    return kind


def hailed(count: int, contrast: float = 0.0, amplitude: float = 0.0) -> Kind:
    """Hail on skin that is clean, dirty or wavy."""

    def kind(rng: np.random.Generator) -> KindScene:
        marks = (Dirt(contrast, seed=seed(rng)),) if contrast else ()
        waves = waviness(amplitude, rng.uniform(0.08, 0.2), seed(rng)) if amplitude else ()
        dents = hail(rng, count)
        return scene(skin(rng, dents=dents, paint=Paint(marks=marks), waves=waves))

    return kind


def narrow(rng: np.random.Generator) -> KindScene:
    """Dents of two to five fringes' width, at 0.6 to 1.2 m."""
    distance = rng.uniform(0.6, 1.2)
    rig = make_rig(distance, 0.24 * distance / 0.8, CAMERA, 1890.0)
    fringe = PATTERN.period_px / 1890.0 * distance
    widths = rng.uniform(2, 5, 6) * fringe
    depths = np.clip(widths * rng.uniform(0.01, 0.05, 6), 0.15e-3, 1.5e-3)
    places = [(i, j) for i in (-0.1, 0.0, 0.1) for j in (-0.04, 0.04)]
    scale = distance / 0.8
    dents = tuple(
        by_contour(x * scale, y * scale, w * rng.uniform(1, 1.3), w, d, rng.uniform(0, 3), shape)
        for (x, y), w, d, shape in zip(
            places, widths, depths, (SMOOTH, Gaussian()) * 3, strict=True
        )
    )
    return scene(skin(rng, distance, dents=dents), rig=rig)


def on_sensor(**options) -> Kind:
    """Clean skin in some light on some sensor."""
    return lambda rng: scene(skin(rng), **options)


def glossy(rng: np.random.Generator) -> KindScene:
    """A highlight that clips."""
    panel = skin(rng, paint=Paint(roughness=rng.uniform(0.08, 0.14)), spread=1.0)
    turn = Pose.from_rpy((0, 0.14 + rng.uniform(-0.03, 0.03), 0), (0, 0, 0)).rotation
    panel = replace(panel, pose=Pose(panel.pose.rotation * turn, panel.pose.translation))
    return scene(panel, exposure=1.3)


def large_pattern(rng: np.random.Generator) -> KindScene:
    """A projector that covers more than the camera sees."""
    rig = make_rig(0.8, 0.24, CAMERA, 1150.0)
    return scene(skin(rng), rig=rig, pattern=Pattern(1280, 720, 8.0, 640.0))


def fractional(rng: np.random.Generator) -> KindScene:
    """Period and stripe that are no whole columns, so that 8 bits round fringes unlike."""
    period = float(rng.choice([7.3, 9.0, 12.5]))
    pattern = Pattern(1280, 720, period, float(rng.uniform(590, 690)))
    return scene(skin(rng), pattern=pattern)


def of_period(rng: np.random.Generator) -> KindScene:
    """Fringes of any period, the stripe anywhere about the middle."""
    period = float(rng.uniform(6, 16))
    pattern = Pattern(1280, 720, period, float(rng.uniform(560, 720)))
    return scene(skin(rng), pattern=pattern)


def moving(rng: np.random.Generator) -> KindScene:
    """0.2 m/s and half a radian a second for 8 ms."""
    motion = Motion(rng.normal(0, 0.5, 3) * 0.008 / 1.7, rng.normal(0, 0.2, 3) * 0.008 / 1.7)
    return scene(skin(rng), motion=motion)


def curved(rng: np.random.Generator) -> KindScene:
    """A fuselage of 2 m radius with all at once: rivets, waves, marks, gloss, daylight, motion."""
    dents = (*three_dents(rng), by_contour(0.13, 0.07, 0.016, 0.016, 0.0004, 0, Gaussian()))
    row = tuple(Rivet(-0.24 + 0.025 * i, 0.005) for i in range(20))
    marks = (
        Dirt(0.12, seed=seed(rng)),
        *scratches(8, VIEW, seed(rng)),
        Lettering(-0.08, -0.08, 'NO STEP', 0.03, (0.1,) * 3),
        Lettering(0.08, 0.045, 'G-FTPD', 0.02, (0.12, 0.12, 0.4)),
    )
    panel = skin(
        rng,
        dents=dents,
        rivets=row,
        cylinder_radius=2.0,
        waves=waviness(1e-4, 0.16, seed(rng)),
        paint=Paint(roughness=0.2, marks=marks),
    )
    motion = Motion(translation=rng.normal(0, 0.05, 3) * 0.004)
    sensor = {'bayer': True, 'jpeg_quality': 85, 'psf_px': 0.8, 'full_well': 8000.0}
    return scene(panel, motion=motion, ambient=0.5, exposure=0.66, read_noise=1.5, **sensor)


def lapped(height: float | None, turn: float) -> Kind:
    """One skin on another: `turn` radians from along the fringes."""

    def kind(rng: np.random.Generator) -> KindScene:
        step = height or float(np.exp(rng.uniform(math.log(0.0005), math.log(0.005))))
        return scene(*lap_panels(rng, step, turn + math.radians(rng.uniform(-3, 3))))

    return kind


def lap_panels(
    rng: np.random.Generator, step: float, turn: float, gap: float = 0.0
) -> tuple[Panel, ...]:
    """Upper skin, lower skin and the wall between; rivets beside, dents on both."""
    base = skin(rng, dents=())
    turned = base.pose @ Pose.from_rpy((0, 0, turn), (0, 0, 0))
    edge = rng.uniform(0.0, 0.04)
    upper_dents = (
        by_contour(edge - 0.085, -0.035, 0.040, 0.040, 0.001),
        by_contour(edge - 0.06, 0.06, 0.025, 0.025, 0.00025, 0, Gaussian()),
    )
    lower_dents = (by_contour(edge + 0.065, 0.03, 0.060, 0.035, 0.0005, rng.uniform(0, 3)),)
    rivets = tuple(Rivet(edge - 0.015, -0.25 + 0.025 * i) for i in range(21))
    lower = turned @ Pose.from_rpy((0, 0, 0), (0, 0, step))
    # The wall's z points back under the upper skin, its x into the aircraft.
    wall = turned @ Pose.from_rpy((0, -math.pi / 2, 0), (edge, 0, 0))
    return (
        Panel(turned, (-2, edge, -2, 2), dents=upper_dents, rivets=rivets),
        Panel(lower, (edge + gap, 2, -2, 2), dents=lower_dents),
        *(() if gap else (Panel(wall, (0, step, -2, 2)),)),
    )


def gapped(rng: np.random.Generator) -> KindScene:
    """Two panels with a gap of 2 to 6 mm."""
    return scene(*lap_panels(rng, 1e-5, rng.uniform(0, math.pi), rng.uniform(0.002, 0.006)))


def seamed(rng: np.random.Generator) -> KindScene:
    """Two panels that all but meet: a dark line of 0.5 to 1.5 mm."""
    return scene(*lap_panels(rng, 1e-5, rng.uniform(0, math.pi), rng.uniform(0.0005, 0.0015)))


def windowed(rng: np.random.Generator) -> KindScene:
    """A window or door without anything behind it."""
    hole = Opening(
        rng.uniform(-0.05, 0.12),
        rng.uniform(-0.06, 0.0),
        rng.uniform(0.05, 0.1),
        rng.uniform(0.04, 0.07),
        rng.uniform(0, 3),
        bool(rng.integers(2)),
    )
    dents = three_dents(rng, (-0.12, -0.03), (0.03, 0.08), (-0.08, 0.075))
    return scene(skin(rng, dents=dents, openings=(hole,)))


def doubled(rng: np.random.Generator) -> KindScene:
    """A thin plate on the skin, turned by any angle, a dent on it and one beside."""
    base = skin(rng, dents=())
    thick = float(rng.uniform(0.0006, 0.002))
    plate = base.pose @ Pose.from_rpy((0, 0, rng.uniform(0, 3)), (0.01, 0.0, -thick))
    dents = three_dents(rng, (-0.13, -0.04), (0.14, 0.05), (-0.1, 0.08))
    on_it = by_contour(0.01, 0.0, 0.03, 0.03, 0.0005)
    upper = Panel(plate, (-0.06, 0.06, -0.04, 0.04), dents=(on_it,))
    return scene(upper, replace(base, dents=dents))


def fitted(kind_of: Callable[[np.random.Generator], tuple[Fitting, ...]]) -> Kind:
    """Fittings beside the dents."""
    return lambda rng: scene(skin(rng, rivets=kind_of(rng)))


def row_of(rivet: type, **options) -> Callable[[np.random.Generator], tuple[Fitting, ...]]:
    """Two rows of rivets, one upright, one level."""

    def rivets(rng: np.random.Generator) -> tuple[Fitting, ...]:
        x, y = rng.uniform(0.012, 0.025), rng.uniform(-0.01, 0.0)
        upright = [rivet(x, -0.2 + 0.025 * i, **options) for i in range(17)]
        level = [rivet(x + 0.02 + 0.025 * i, y - 0.04, **options) for i in range(12)]
        return (*upright, *level)

    return rivets


def some_missing(rng: np.random.Generator) -> tuple[Fitting, ...]:
    """Flush rivets of which a few are gone."""
    return tuple(
        MissingRivet(rivet.x, rivet.y) if rng.random() < 0.15 else rivet
        for rivet in row_of(Rivet)(rng)
    )


def sealed(rng: np.random.Generator) -> tuple[Fitting, ...]:
    """Beads of sealant along and across the fringes."""
    return (
        Bead(rng.uniform(-0.03, 0.01), -0.03, 0.12, angle=math.pi / 2 + rng.uniform(-0.1, 0.1)),
        Bead(0.09, -0.05, 0.14, angle=rng.uniform(-0.1, 0.1), proud=0.0006),
    )


def wavy(amplitude: float | None = None) -> Kind:
    """Waviness of 0.05 to 0.3 mm, 40 to 200 mm long."""

    def kind(rng: np.random.Generator) -> KindScene:
        high = amplitude or float(rng.uniform(0.05e-3, 0.3e-3))
        return scene(skin(rng, waves=waviness(high, rng.uniform(0.04, 0.2), seed(rng))))

    return kind


KINDS: dict[str, Kind] = {
    'clean': on_sensor(),
    'large_pattern': large_pattern,
    'period': of_period,
    'fractional': fractional,
    'narrow_dents': narrow,
    'sun_edge': lambda rng: sunny(rng, 0.0),
    'sun_edge_soft': lambda rng: sunny(rng, float(rng.uniform(0.003, 0.015))),
    'paint_edge': painted,
    'lettering': lettered,
    'patches': patched,
    'scratches': scratched,
    'dirt10': dirty(0.10),
    'dirt25': dirty(0.25),
    'streaks_along': streaked(math.pi / 2),
    'streaks_across': streaked(0.0),
    'hail': hailed(14),
    'hail_dirt25': hailed(14, contrast=0.25),
    'hail_wavy': hailed(14, amplitude=1e-4),
    'wavy': wavy(),
    'gloss': glossy,
    'over_half': on_sensor(exposure=1.7),
    'over_1': on_sensor(exposure=2.4),
    'contrast15': on_sensor(ambient=2.8, exposure=0.3),
    'dark25': on_sensor(exposure=0.13),
    'jpeg60': on_sensor(jpeg_quality=60),
    'jpeg30': on_sensor(jpeg_quality=30),
    'blur3': on_sensor(psf_px=3.0),
    'crosstalk20': on_sensor(crosstalk=0.2),
    'bayer': on_sensor(bayer=True),
    'gamma': on_sensor(camera_gamma=2.2),
    'speckle10': on_sensor(speckle_contrast=0.1),
    'motion': moving,
    'lap_along': lapped(None, 0.0),
    'lap_across': lapped(None, math.pi / 2),
    'lap_aslant': lapped(None, math.radians(40)),
    'seam': seamed,
    'gap': gapped,
    'opening': windowed,
    'doubler': doubled,
    'rivets': fitted(row_of(Rivet)),
    'rivets_domed': fitted(row_of(DomedRivet)),
    'rivets_missing': fitted(some_missing),
    'sealant': fitted(sealed),
    'fuselage': curved,
}
