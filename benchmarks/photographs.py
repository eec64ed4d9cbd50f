"""What the gate photographs: skins, lights and cameras, families of dents, the paper's tiles.

Each is a function of a random generator that gives a `Scene`; a scene is photographed under either
pattern. The kinds are fixed: no new one is invented.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import cv2
import numpy as np
from ground_truth import GroundTruth, ground_truth
from numpy.typing import NDArray

from ftp_dent_ros.evaluation.scenes import (
    DYNAMIC_RIG,
    SAMPLES,
    SPEED,
    STATIC_RIG,
    make_rig,
    sample,
    simulated_dent,
)
from ftp_dent_ros.evaluation.scenes import PATTERN as PAPER_PATTERN
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.photograph.photograph import Photograph
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.rig.rig import Rig
from ftp_dent_ros.simulation import (
    CameraMotion,
    Dent,
    Dirt,
    Lettering,
    Paint,
    Panel,
    Photometry,
    Renderer,
    Rivet,
    Sunlight,
    Surface,
    domed_rivet,
    scratches,
    waviness,
)
from ftp_dent_ros.simulation.dents import (
    SMOOTH,
    Cap,
    Crater,
    FlatBottomed,
    Gaussian,
    Plate,
    RaisedCosine,
    Shape,
    Valley,
)
from ftp_dent_ros.simulation.paint import Print, letters_of

CAMERA = 1280, 720, 1700.0
PATTERN = Pattern(1280, 720, 10.0, 640.0)
RIG = make_rig(0.8, 0.24, CAMERA, 1890.0)
# Of the clouds, and of their truth: every so many pixels.
STRIDE = 2
# Beyond all views, metres.
_FAR = 2.0
_ENDLESS = (-_FAR, _FAR, -_FAR, _FAR)
# The skin in view at 0.8 m, metres.
_VIEW = (-0.22, 0.22, -0.12, 0.12)
# A dent is no deeper than this part of its width: skin folds before.
_STEEPEST = 1 / 12
# Of the paper's simulation: noise of the phase, radians (section 3).
_PHASE_NOISE = 0.6

Random = np.random.Generator
# What becomes of a drawn pattern before it leaves the projector.
Optics = Callable[[NDArray[np.uint8]], NDArray[np.uint8]]


@dataclass(frozen=True, eq=False)
class Scene:
    """Panels before a rig, in some light."""

    rig: Rig
    panels: tuple[Panel, ...]
    photometry: Photometry
    pattern: Pattern = PATTERN
    motion: CameraMotion = field(default_factory=CameraMotion)
    optics: Optics | None = None

    @property
    def surface(self) -> Surface:
        """The panels together."""
        return Surface(self.panels)

    def bare(self) -> Scene:
        """The same without dents."""
        return replace(self, panels=tuple(replace(panel, dents=()) for panel in self.panels))

    def under(self, code: str) -> Scene:
        """The same under the pattern of a code."""
        return replace(self, pattern=replace(self.pattern, code=code))

    def renderer(self) -> Renderer:
        """Of its rig, pattern and light."""
        drawn = self.pattern.draw()
        projected = self.optics(drawn) if self.optics else drawn
        return Renderer(self.rig, projected, self.photometry)

    def photograph(self, rng: Random) -> Photograph:
        """What the camera takes."""
        return self.renderer().photograph(self.surface, rng, self.motion)

    def truth(self) -> GroundTruth:
        """What every `STRIDE`-th pixel shows."""
        period = self.pattern.period_px
        return ground_truth(self.renderer(), self.surface, period, STRIDE, self.motion)


Kind = Callable[[Random], Scene]


def by_contour(x, y, length, width, depth, angle=0.0, shape: Shape = SMOOTH) -> Dent:
    """A dent whose 10 % contour has these sizes, metres."""
    part, _ = Dent(0, 0, 1, 1, 1, 0, shape).size()
    return Dent(x, y, length / part, width / part, depth, angle, shape)


def three_dents(rng: Random, *places: tuple[float, float]) -> tuple[Dent, ...]:
    """1.0 mm x 40 mm, 0.5 mm x 60 x 35 mm and 0.25 mm x 25 mm, at places or where they fit."""
    places = places or ((-0.08, -0.035), (0.07, 0.03), (-0.02, 0.075))
    a, b, c = (np.array(place) + rng.uniform(-0.008, 0.008, 2) for place in places)
    return (
        by_contour(*a, 0.040, 0.040, 0.001),
        by_contour(*b, 0.060, 0.035, 0.0005, rng.uniform(0, math.pi)),
        by_contour(*c, 0.025, 0.025, 0.00025, 0.0, Gaussian()),
    )


def skin(rng: Random, distance: float = 0.8, spread: float = 3.0, **options) -> Panel:
    """A panel that fills the frame, tilted by a few degrees."""
    tilt = np.radians(rng.uniform(-spread, spread, 2))
    pose = Pose.from_rpy((*tilt, math.radians(rng.uniform(-2, 2))), (0, 0, distance))
    options.setdefault('dents', three_dents(rng))
    return Panel(pose, _ENDLESS, **options)


def scene(*panels: Panel, rig: Rig = RIG, motion: CameraMotion | None = None, **light) -> Scene:
    """Panels in a light that gives a white skin 85 % of saturation, and some daylight."""
    distance = float(panels[0].pose.translation[2])
    usual = {'exposure': 1.0, 'ambient': 0.03, 'samples': 8, 'reference_distance': distance}
    return Scene(rig, panels, Photometry(**usual | light), motion=motion or CameraMotion())


def seed(rng: Random) -> int:
    """A seed of marks."""
    return int(rng.integers(1 << 30))


def seen_by(**light) -> Kind:
    """Clean skin in some light, seen by some sensor."""
    return lambda rng: scene(skin(rng), **light)


def marked(**dirt) -> Kind:
    """Dirt, of scales from 64 mm down to 4 mm if nothing else is said."""
    return lambda rng: scene(skin(rng, paint=Paint(marks=(Dirt(seed=seed(rng), **dirt),))))


def curved(rng: Random) -> Scene:
    """Glossy skin of 1 to 3 m radius."""
    radius = float(rng.uniform(1.0, 3.0))
    return scene(skin(rng, cylinder_radius=radius, paint=Paint(roughness=0.2)))


def hailed(contrast: float) -> Kind:
    """14 dents of 10 to 25 mm, 0.1 to 0.6 mm deep, apart from one another, on dirt or clean."""

    def kind(rng: Random) -> Scene:
        dents: list[Dent] = []
        while len(dents) < 14:
            x, y = rng.uniform(-0.17, 0.15), rng.uniform(-0.075, 0.075)
            size = rng.uniform(0.010, 0.025)
            if all(math.hypot(x - d.x, y - d.y) > (size + d.length) * 0.75 for d in dents):
                depth, width = log_uniform(rng, 0.1e-3, 0.6e-3), size * rng.uniform(0.85, 1)
                dents.append(by_contour(x, y, size, width, depth, 0, Gaussian()))
        marks = (Dirt(contrast, seed=seed(rng)),) if contrast else ()
        return scene(skin(rng, dents=tuple(dents), paint=Paint(marks=marks)))

    return kind


def across_edge(rng: Random) -> tuple[tuple[float, float, float], tuple[Dent, ...]]:
    """An edge through the middle of three dents, upright to aslant, and the dents on it."""
    angle = math.radians(rng.uniform(-35, 35))
    offset = rng.uniform(-0.03, 0.05)
    along = np.array([-math.sin(angle), math.cos(angle)])
    normal = np.array([math.cos(angle), math.sin(angle)])
    low, middle, high = (
        tuple(offset * normal + t * along + rng.uniform(-0.004, 0.004, 2))
        for t in (-0.06, 0.0, 0.06)
    )
    dents = (
        by_contour(*middle, 0.040, 0.040, 0.001),
        by_contour(*high, 0.030, 0.030, 0.0005, 0.0, Gaussian()),
        by_contour(*low, 0.025, 0.025, 0.00025, 0.0, Gaussian()),
        by_contour(-0.13, rng.uniform(-0.05, 0.05), 0.025, 0.025, 0.00025, 0.0, Gaussian()),
    )
    return (float(normal[0]), float(normal[1]), float(offset)), dents


def sunny(low: float, high: float) -> Kind:
    """The edge of a shadow across dents, its half shadow so wide, metres."""

    def kind(rng: Random) -> Scene:
        edge, dents = across_edge(rng)
        sun = Sunlight(rng.uniform(0.6, 1.1), edge, float(rng.uniform(low, high)))
        return scene(skin(rng, dents=dents, sunlight=(sun,)), exposure=0.48)

    return kind


def painted(rng: Random) -> Scene:
    """The edge of a livery's paint across dents."""
    edge, dents = across_edge(rng)
    tone = rng.uniform(0.2, 0.45)
    paint = Paint((0.75,) * 3, edge, (tone, tone * 0.95, tone * 1.05))
    return scene(skin(rng, dents=dents, paint=paint))


def lettered(rng: Random) -> Scene:
    """Letters of three sizes, one line through the dents."""
    dents = three_dents(rng)
    tint = rng.uniform(0.08, 0.4)
    marks = (
        Lettering(dents[0].x + 0.005, dents[0].y, 'NO STEP', 0.03, (tint,) * 3, 0.05),
        Lettering(dents[1].x - 0.01, dents[1].y, 'G-FTPD 017', 0.02, (tint, tint, 0.5), 0.02),
        Lettering(dents[2].x + 0.03, dents[2].y, 'STATIC PORT - KEEP CLEAR', 0.006, (0.2,) * 3),
        Lettering(0.1, -0.09, 'HOIST POINT 4', 0.012, (0.7, 0.12, 0.12), -0.01),
    )
    return scene(skin(rng, dents=dents, paint=Paint(marks=marks)))


def lapped(turn: float) -> Kind:
    """One skin 0.5 to 5 mm over another, the wall between them, rivets beside, dents on both."""

    def kind(rng: Random) -> Scene:
        step = log_uniform(rng, 0.0005, 0.005)
        aslant = turn + math.radians(rng.uniform(-3, 3))
        upper = skin(rng, dents=()).pose @ Pose.from_rpy((0, 0, aslant), (0, 0, 0))
        edge = rng.uniform(0.0, 0.04)
        upper_dents = (
            by_contour(edge - 0.085, -0.035, 0.040, 0.040, 0.001),
            by_contour(edge - 0.06, 0.06, 0.025, 0.025, 0.00025, 0, Gaussian()),
        )
        lower_dents = (by_contour(edge + 0.065, 0.03, 0.060, 0.035, 0.0005, rng.uniform(0, 3)),)
        rivets = tuple(Rivet(edge - 0.015, -0.25 + 0.025 * i) for i in range(21))
        lower = upper @ Pose.from_rpy((0, 0, 0), (0, 0, step))
        # The wall's z points back under the upper skin, its x into the aircraft.
        wall = upper @ Pose.from_rpy((0, -math.pi / 2, 0), (edge, 0, 0))
        return scene(
            Panel(upper, (-_FAR, edge, -_FAR, _FAR), dents=upper_dents, rivets=rivets),
            Panel(lower, (edge, _FAR, -_FAR, _FAR), dents=lower_dents),
            Panel(wall, (0, step, -_FAR, _FAR)),
        )

    return kind


def stepped(rng: Random) -> Scene:
    """Two skins 10 to 60 mm one behind the other, cut upright to aslant, dents on both."""
    turn = Pose.from_rpy((0, 0, rng.uniform(-0.6, 0.6)), (0, 0, 0))
    near = skin(rng, dents=()).pose @ turn
    far = near @ Pose.from_rpy((0, 0, 0), (0, 0, rng.uniform(0.01, 0.06)))
    edge = rng.uniform(-0.04, 0.04)
    a, b, c = three_dents(rng, (edge - 0.06, -0.02), (edge + 0.09, 0.03), (edge - 0.08, 0.06))
    return scene(
        Panel(near, (-_FAR, edge, -_FAR, _FAR), dents=(a, c)),
        Panel(far, (edge, _FAR, -_FAR, _FAR), dents=(b,)),
    )


def standing_before(rng: Random) -> Scene:
    """A grey board of 60 to 130 mm that stands 10 to 60 mm before the skin."""
    base = skin(rng, dents=three_dents(rng, (-0.13, -0.04), (0.14, 0.05), (-0.1, 0.07)))
    place = (*rng.uniform((0.0, -0.04), (0.06, 0.02)), -rng.uniform(0.01, 0.06))
    pose = base.pose @ Pose.from_rpy((0, 0, rng.uniform(0, 3)), place)
    across, along = rng.uniform(0.03, 0.065, 2)
    board = Panel(pose, (-across, across, -along, along), paint=Paint((0.5,) * 3))
    return scene(base, board)


def riveted(rivet: Callable[[float, float], Any]) -> Kind:
    """Two rows of rivets, one upright, one level, beside the dents."""

    def kind(rng: Random) -> Scene:
        x, y = rng.uniform(0.012, 0.025), rng.uniform(-0.01, 0.0)
        upright = [rivet(x, -0.2 + 0.025 * i) for i in range(17)]
        level = [rivet(x + 0.02 + 0.025 * i, y - 0.04) for i in range(12)]
        return scene(skin(rng, rivets=(*upright, *level)))

    return kind


def glossy(rng: Random) -> Scene:
    """A highlight that clips."""
    panel = skin(rng, paint=Paint(roughness=rng.uniform(0.08, 0.14)), spread=1.0)
    turn = Pose.from_rpy((0, 0.14 + rng.uniform(-0.03, 0.03), 0), (0, 0, 0)).rotation
    pose = Pose(panel.pose.rotation * turn, panel.pose.translation)
    return scene(replace(panel, pose=pose), exposure=1.3)


def moving(rng: Random) -> Scene:
    """0.2 m/s and half a radian a second for 8 ms."""
    motion = CameraMotion(rng.normal(0, 0.5, 3) * 0.008 / 1.7, rng.normal(0, 0.2, 3) * 0.008 / 1.7)
    return scene(skin(rng), motion=motion)


def wavy(rng: Random) -> Scene:
    """Waviness of 0.05 to 0.3 mm, 40 to 200 mm long."""
    high = float(rng.uniform(0.05e-3, 0.3e-3))
    return scene(skin(rng, waves=waviness(high, rng.uniform(0.04, 0.2), seed(rng))))


def all_at_once(rng: Random) -> Scene:
    """A fuselage of 2 m radius with rivets, waves, marks, gloss, daylight, motion and JPEG."""
    dents = (*three_dents(rng), by_contour(0.13, 0.07, 0.016, 0.016, 0.0004, 0, Gaussian()))
    marks = (
        Dirt(0.12, seed=seed(rng)),
        *scratches(8, _VIEW, seed(rng)),
        Lettering(-0.08, -0.08, 'NO STEP', 0.03, (0.1,) * 3),
        Lettering(0.08, 0.045, 'G-FTPD', 0.02, (0.12, 0.12, 0.4)),
    )
    panel = skin(
        rng,
        dents=dents,
        rivets=tuple(Rivet(-0.24 + 0.025 * i, 0.005) for i in range(20)),
        cylinder_radius=2.0,
        waves=waviness(1e-4, 0.16, seed(rng)),
        paint=Paint(roughness=0.2, marks=marks),
    )
    motion = CameraMotion(translation=rng.normal(0, 0.05, 3) * 0.004)
    sensor = {'bayer': True, 'jpeg_quality': 85, 'psf_px': 0.8, 'full_well': 8000.0}
    return scene(panel, motion=motion, ambient=0.5, exposure=0.66, read_noise=1.5, **sensor)


def overdriven(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Fringes cut off above and below: their third harmonic is a fifth of them."""
    return np.rint(np.clip(127 + 2.2 * (image - 127.0), 0, 254)).astype(np.uint8)


def smeared(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """A tail to one side, which grows from no light to all of it from corner to corner.

    The tail falls so that fringes of `PATTERN` lose contrast, but stay in their places.
    """
    decay = 0.5 / math.cos(2 * math.pi / PATTERN.period_px)
    tail = (1 - decay) * decay ** np.arange(16)[None]
    smear = cv2.filter2D(image, cv2.CV_64F, tail, anchor=(1, 0), borderType=cv2.BORDER_CONSTANT)
    height, width, _ = image.shape
    share = np.add.outer(np.linspace(0, 0.5, height), np.linspace(0, 0.5, width))[..., None]
    return np.rint((1 - share) * image + share * smear).astype(np.uint8)


def projected_by(optics: Optics, period: float = PATTERN.period_px, **light) -> Kind:
    """Clean skin in the light of a projector that changes the pattern."""
    pattern = replace(PATTERN, period_px=period)
    return lambda rng: replace(scene(skin(rng), **light), optics=optics, pattern=pattern)


def printed(ink: NDArray[np.bool_], least: float, most: float, period: float) -> Kind:
    """A tilted board full of copies of an image, its pixels `least` to `most` of the camera's."""

    def kind(rng: Random) -> Scene:
        pixel = float(rng.uniform(least, most)) * 0.8 / CAMERA[2]
        copies = np.ceil([0.5 / pixel, 0.8 / pixel] / np.array(ink.shape)).astype(int)
        x, y = rng.uniform((-0.4, -0.25), (-0.35, -0.2)).tolist()
        paint = Print((0.9,) * 3, albedo_beyond=(0.1,) * 3, pixel=pixel, origin=(x, y))
        board = skin(rng, spread=12.0, dents=(), paint=replace(paint, ink=np.tile(ink, copies)))
        return replace(scene(board), pattern=replace(PATTERN, period_px=period))

    return kind


KINDS: dict[str, Kind] = {
    'clean': seen_by(),
    'curved, glossy': curved,
    'dirt of 10 %': marked(contrast=0.10),
    'dirt of 25 %': marked(contrast=0.25),
    'streaks along': marked(contrast=0.2, scales=(0.012, 0.003), stretch=25, angle=math.pi / 2),
    'hail': hailed(0.0),
    'hail on dirt': hailed(0.25),
    'livery edge': painted,
    'letters': lettered,
    'lap along': lapped(0.0),
    'lap across': lapped(math.pi / 2),
    'step': stepped,
    'foreground': standing_before,
    'rivets': riveted(Rivet),
    'domed rivets': riveted(domed_rivet),
    'sun edge': sunny(0.0, 0.0),
    'soft sun edge': sunny(0.003, 0.015),
    'daylight': seen_by(ambient=2.8, exposure=0.3),
    'highlight': glossy,
    'blur': seen_by(psf_px=3.0),
    'motion': moving,
    'waves': wavy,
    'raw': seen_by(encoding='bayer_rggb12'),
    'grey': seen_by(encoding='mono8'),
    'all at once': all_at_once,
    'nearly binary': projected_by(overdriven, 32.0),
    'skew blur': projected_by(smeared, defocus_px=1.5),
    '3 grey levels': seen_by(ambient=8.5, exposure=0.045),
}

_SQUARES = np.eye(2, dtype=bool)
# 50 pixels a letter's height.
_LETTERS = letters_of('NO STEP 017 ')[::4, ::4] > 0.5
PRINTS: dict[str, Kind] = {}
for _period in (9.0, 16.0, 32.0, 64.0, 130.0):
    PRINTS[f'squares, {_period:g} px'] = printed(_SQUARES, 65, 100, _period)
    PRINTS[f'letters, {_period:g} px'] = printed(_LETTERS, _period / 50, _period / 50, _period)

Family = Callable[[Random], tuple[Dent, ...]]


def log_uniform(rng: Random, low: float, high: float) -> float:
    """Between two positive numbers, each octave as likely."""
    return float(np.exp(rng.uniform(math.log(low), math.log(max(low, high)))))


def rounded(shape: Callable[[Random], Shape], low: float = 0.008) -> Family:
    """Dents of a shape, from `low` to 100 mm long, 0.1 to 5 mm deep."""

    def family(rng: Random) -> tuple[Dent, ...]:
        length = log_uniform(rng, low, 0.1)
        width = max(length * rng.uniform(0.5, 1), 0.008)
        depth = log_uniform(rng, 1e-4, min(5e-3, width * _STEEPEST))
        length = max(length, width)
        return (by_contour(0, 0, length, width, depth, rng.uniform(0, 3), shape(rng)),)

    return family


def crease(rng: Random) -> tuple[Dent, ...]:
    """0.3 to 3 mm deep, 5 to 15 mm wide, sharp at its bottom."""
    width = rng.uniform(0.006, 0.016)
    depth = log_uniform(rng, 3e-4, 0.25 * width)
    blunt = Valley(float(rng.uniform(0.03, 0.15)))
    return (Dent(0, 0, rng.uniform(0.03, 0.1), width, depth, rng.uniform(0, 3), blunt),)


def gouge(rng: Random) -> tuple[Dent, ...]:
    """A groove 3 to 8 mm wide, with a light mark."""
    width = rng.uniform(0.003, 0.008)
    length, angle = rng.uniform(0.015, 0.06), rng.uniform(0, 3)
    depth = log_uniform(rng, 2e-4, 0.1 * width + 2e-4)
    valley, mark = Valley(float(rng.uniform(0.1, 0.3)), 'gouge'), float(rng.uniform(1.15, 1.25))
    return (Dent(0, 0, length, width, depth, angle, valley, mark),)


def double(rng: Random) -> tuple[Dent, ...]:
    """Two dents whose centres are 0.4 to 1.2 widths apart."""
    width = log_uniform(rng, 0.015, 0.05)
    depth = log_uniform(rng, 2e-4, min(2e-3, width * _STEEPEST))
    apart, towards = width * rng.uniform(0.4, 1.2), rng.uniform(0, 2 * math.pi)
    half = apart / 2 * np.array([math.cos(towards), math.sin(towards)])
    return tuple(
        by_contour(*(sign * half), width * grow, width * grow, depth * rng.uniform(0.6, 1))
        for sign, grow in ((1, 1.0), (-1, rng.uniform(0.8, 1)))
    )


FAMILIES: dict[str, Family] = {
    'eq. 18': rounded(lambda rng: SMOOTH),
    'cosine': rounded(lambda rng: RaisedCosine()),
    'gaussian': rounded(lambda rng: Gaussian()),
    'cap': rounded(lambda rng: Cap()),
    'flat': rounded(lambda rng: FlatBottomed(rng.uniform(0.3, 0.7))),
    'crater': rounded(lambda rng: Crater(rng.uniform(0.1, 0.3), rng.uniform(0.6, 0.8)), 0.015),
    'oil can': rounded(lambda rng: Plate(), 0.06),
    'crease': crease,
    'gouge': gouge,
    'double': double,
}


def shaped(family: Family) -> Kind:
    """Three dents of a family as far as there is room, 0.6 to 1.2 m away, on flat or bent skin."""

    def kind(rng: Random) -> Scene:
        distance = float(rng.choice([0.6, 0.8, 1.0, 1.2]))
        reach = np.array([0.20, 0.10]) * distance
        dents: list[Dent] = []
        discs: list[tuple[float, float, float]] = []
        for _ in range(3):
            some = family(rng)
            radius = max(math.hypot(d.x, d.y) + d.size()[0] / 2 for d in some)
            for _ in range(200):
                x, y = rng.uniform(-1, 1, 2) * np.maximum(reach - radius, 0.1 * reach)
                if all(math.hypot(x - a, y - b) > 1.6 * (radius + r) for a, b, r in discs):
                    discs.append((x, y, radius))
                    dents += [replace(d, x=d.x + float(x), y=d.y + float(y)) for d in some]
                    break
        panel = skin(
            rng,
            distance,
            8.0,
            cylinder_radius=float(rng.choice([0.0, 2.0])),
            paint=Paint(roughness=float(rng.choice([0.0, 0.25]))),
            dents=tuple(dents),
        )
        return scene(panel, rig=make_rig(distance, 0.3 * distance, CAMERA, 1890.0))

    return kind


SHAPES: dict[str, Kind] = {name: shaped(family) for name, family in FAMILIES.items()}


def of_the_paper(made: Callable[[], object]) -> Kind:
    """A scene of the paper, which is always the same."""

    def kind(_: Random) -> Scene:
        one = made()
        return Scene(one.rig, one.panels, one.photometry, PAPER_PATTERN, one.motion)

    return kind


PAPER: dict[str, Kind] = {
    **{
        f'{name}, 60 cm': of_the_paper(lambda name=name: sample(name, STATIC_RIG, 0.6))
        for name in SAMPLES
    },
    **{
        f'{name}, 120 cm, moving': of_the_paper(
            lambda name=name: sample(name, DYNAMIC_RIG, 1.2, SPEED)
        )
        for name in SAMPLES
    },
    'section 3': of_the_paper(simulated_dent),
    'section 3, noisy phase': of_the_paper(lambda: simulated_dent(_PHASE_NOISE)),
}
