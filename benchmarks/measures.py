"""What is measured of a photograph: its cloud's errors, and the dents found, against the truth.

Every measure is a dictionary of figures by name; what is refused has the figure `refusals` of 1
and a reason. Lengths are millimetres; "over u" is an error over its stated standard uncertainty.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np
from ground_truth import GroundTruth
from numpy.typing import NDArray
from photographs import KINDS, PAPER, STRIDE, Kind, Scene

from ftp_dent_ros import inspect, reconstruct
from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.dents.dent import Inspection, MeasuredDent, SmallestDent
from ftp_dent_ros.inspection.measuring.lattice import LEVEL
from ftp_dent_ros.pattern.pattern import CODES, Pattern
from ftp_dent_ros.rig.rig import Rig
from ftp_dent_ros.simulation import Dent, Surface
from ftp_dent_ros.simulation.dents import Shape
from ftp_dent_ros.simulation.truth import TrueDent, match_truth, true_dents

MM = 1e3
SIZES = 'depth', 'length', 'width'
PAPERS_METHOD = 'virtual-reference'
# Errors beyond so many sigma are counted.
WILD = 4
# Share of the points with the smallest sigma.
SUREST = 0.95
# How far off its truth what is found may lie at least, metres.
NEAREST = 0.010
# Kinds that a true dent counts as listed under.
_DENTED = 'dent', 'crease'
# Around a fitting what is found is its own; around a dent it is part of that; metres.
_BESIDE_FITTING, _BESIDE_DENT = 0.006, 0.03

Figures = dict[str, Any]


@contextmanager
def attempt(figures: Figures) -> Iterator[None]:
    """A refusal, or a crash, is a figure: the class of what was raised is kept as the reason."""
    figures['refusals'] = 0
    try:
        yield
    except Exception as reason:
        figures |= {'refusals': 1, 'reason': type(reason).__name__}


def root_mean_square(values) -> float:
    """Of those that are numbers; NaN without any."""
    values = np.asarray(values, float)
    values = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(values * values))) if len(values) else math.nan


def of_points(cloud: Cloud, error: NDArray, lit: NDArray[np.bool_], fringe: NDArray) -> Figures:
    """Of a cloud, on what is lit.

    Parameters
    ----------
    error : ndarray, shape (rows, columns)
        Of the points along their rays, metres.
    fringe : ndarray, shape (rows, columns)
        Depth between neighbouring fringes, metres.
    """
    on = cloud.valid & lit
    figures: Figures = {'coverage': float(on.sum() / max(lit.sum(), 1))}
    if on.any():
        error, sigma = error[on], cloud.sigma[on]
        size = MM * np.abs(error)
        figures |= {'mae_mm': float(size.mean()), 'p95_mm': float(np.percentile(size, 95))}
        figures['wrong_order'] = float((np.abs(error) > fringe[on] / 2).mean())
        surest = error[sigma <= np.quantile(sigma, SUREST)]
        figures['rms_lowered'] = 1 - root_mean_square(surest) / root_mean_square(error)
        ratio = error / sigma
        ratio = ratio[np.isfinite(ratio)]
        if len(ratio):
            figures['error_over_sigma'] = root_mean_square(ratio)
            figures['wild'] = float((np.abs(ratio) > WILD).mean())
    return figures


def fringe_depth(rig: Rig, pattern: Pattern, depth: NDArray) -> NDArray:
    """Depth between neighbouring fringes at a depth, metres, where the axes are parallel."""
    focal = rig.projector.camera_matrix[0, 0]
    spacing: NDArray = depth**2 * pattern.period_px / (focal * np.linalg.norm(rig.translation))
    return spacing


def visible(scene: Scene, truth: GroundTruth) -> list[TrueDent]:
    """True dents whose whole 10 % contour is lit, and in view; `merged` ones as one."""
    panels = tuple(replace(panel, dents=merged(panel.dents)) for panel in scene.panels)
    shown = []
    for true in true_dents(Surface(panels)):
        pixels = np.rint(scene.rig.camera.project(true.outline) / STRIDE).astype(int)
        inside = (pixels >= 0).all() and (pixels < np.array(truth.lit.shape)[::-1]).all()
        if inside and truth.lit[pixels[:, 1], pixels[:, 0]].mean() > 0.99:
            shown.append(true)
    return shown


@dataclass(frozen=True)
class _Joint(Shape):
    """Two dents as one: their heights over the largest, u and v in `scale` from the first one."""

    dents: tuple[Dent, Dent]
    scale: float
    depth: float

    def fraction(self, u: NDArray, v: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        x, y = self.dents[0].x + self.scale * u, self.dents[0].y + self.scale * v
        height, along_x, along_y = np.add(*(dent.height(x, y) for dent in self.dents))
        part = self.scale / self.depth
        return height / self.depth, part * along_x, part * along_y


def merged(dents: Sequence[Dent]) -> tuple[Dent, ...]:
    """Dents of a panel, and two that no saddle parts as the one that they are.

    Skin with one bottom has one dent: nothing shows which shapes it is the sum of. A saddle that
    parts two rises above the lesser by `LEVEL` of its depth, as the docs say.
    """
    left = list(dents)
    for one, other in combinations(dents, 2):
        share = np.linspace(-0.25, 1.25, 601)
        x, y = one.x + share * (other.x - one.x), one.y + share * (other.y - one.y)
        depth = one.height(x, y)[0] + other.height(x, y)[0]
        between = np.where((share >= 0) & (share <= 1), depth, np.inf)
        saddle = int(np.argmin(between))
        lesser = min(depth[: saddle + 1].max(), depth[saddle:].max())
        if depth[saddle] > (1 - LEVEL) * lesser:
            scale = math.hypot(one.x - other.x, one.y - other.y) + one.reach + other.reach
            deepest = float(depth.max())
            shape = _Joint((one, other), scale, deepest)
            left = [dent for dent in left if dent not in (one, other)]
            left.append(Dent(one.x, one.y, 2 * scale, 2 * scale, deepest, 0.0, shape))
    return tuple(left)


def of_dents(
    found: Inspection,
    true: list[TrueDent],
    pixels: list[tuple[int, int]],
    elsewhere: Callable[[MeasuredDent], bool] = lambda _: True,
) -> Figures:
    """Of what is found, `elsewhere` telling what is on nothing that is known of.

    The row and column of each true dent's centre is where its inspection says from which depth
    on dents are findable: of those deeper, and as wide as that is of, it counts the kinds.
    """
    # Of steps those all round something may be a flat dent: they are a word on it, no more.
    every = (*found.dents, *found.others)
    listed = [m for m in every if m.kind != 'step' or m.width.is_measured]
    # A bump beside a dent, as a crater's rim, is not that dent.
    alike = np.sign(np.multiply.outer([m.depth.value for m in listed], [t.depth for t in true]))
    reaches = np.array([max(NEAREST, t.length / 2) for t in true]) * np.maximum(alike, 0)
    pairs = match_truth([m.position for m in listed], [t.position for t in true], reaches)
    unmatched = (m for i, m in enumerate(listed) if i not in pairs.values())
    left = [m for m in unmatched if m.kind != 'step' and elsewhere(m)]
    doubtful = sum(m.kind == 'other' for m in left)
    figures: Figures = {'false': len(left) - doubtful, 'doubtful': doubtful}
    if not true:
        return figures
    dents = {i: j for i, j in pairs.items() if listed[j].kind != 'step'}
    figures['found'] = len(dents) / len(true)
    several = [m for m in listed if 'may be several' in m.reason]

    def word(dent: TrueDent) -> str:
        apart = (np.linalg.norm(m.position - dent.position) - m.length.value / 2 for m in several)
        return 'other' if min(apart, default=0) < 0 else ''

    findable = [
        listed[pairs[i]].kind if i in pairs else word(dent)
        for i, (dent, at) in enumerate(zip(true, pixels, strict=True))
        if dent.depth > found.findable[at] and dent.width >= SmallestDent().smallest_width
    ]
    if findable:
        dented, nothing = sum(kind in _DENTED for kind in findable), findable.count('')
        shares = dented, len(findable) - dented - nothing, nothing
        names = 'findable_listed', 'findable_doubted', 'findable_missed'
        figures |= {n: s / len(findable) for n, s in zip(names, shares, strict=True)}
    matched = [(listed[j], true[i]) for i, j in dents.items()]
    for name in SIZES:
        sizes = [
            (getattr(m, name), getattr(t, name))
            for m, t in matched
            if name == 'depth' or not m.is_cut
        ]
        over = [(measured.value - true) / measured.uncertainty for measured, true in sizes]
        figures[f'{name}_over_u'] = root_mean_square(over)
        if sizes:
            off = [abs(measured.value / true - 1) for measured, true in sizes]
            figures[f'{name}_off'] = float(np.median(off))
    return figures


def pixel_of(rig: Rig, step: int, dent: TrueDent) -> tuple[int, int]:
    """Row and column of a dent's centre, of every `step`-th pixel."""
    column, row = np.rint(rig.camera.project(dent.position) / step).astype(int)
    return int(row), int(column)


def fittings(scene: Scene) -> list[tuple[NDArray, float]]:
    """Where fittings are in the camera's frame, and how far around them."""
    places = []
    for panel in scene.panels:
        for fitting in panel.rivets:
            height, _, _ = panel.bare_height(np.array([fitting.x]), np.array([fitting.y]))
            place = panel.pose.apply(np.array([fitting.x, fitting.y, height[0]]))
            places.append((place, fitting.reach + _BESIDE_FITTING))
    return places


def of_photograph(
    scene: Scene, truth: GroundTruth | None, rng: np.random.Generator, **settings
) -> Figures:
    """One photograph; the points are not measured without a truth."""
    figures: Figures = {}
    known = [*fittings(scene), *((t.position, _BESIDE_DENT) for t in true_dents(scene.surface))]

    def elsewhere(m: MeasuredDent) -> bool:
        return all(np.linalg.norm(m.position - place) > reach for place, reach in known)

    with attempt(figures):
        photograph = scene.photograph(rng)
        cloud = reconstruct(photograph, scene.rig, scene.pattern, stride=STRIDE, **settings).cloud
        if truth is not None:
            error = (cloud.points[..., 2] - truth.depth) * truth.along_ray
            fringe = fringe_depth(scene.rig, scene.pattern, truth.depth)
            figures |= of_points(cloud, error, truth.lit, fringe)
        if 'method' not in settings:
            true = [] if truth is None else visible(scene, truth)
            pixels = [pixel_of(scene.rig, STRIDE, dent) for dent in true]
            figures |= of_dents(inspect(cloud), true, pixels, elsewhere)
    return figures


def generator(seed: int, draw: int, name: str) -> np.random.Generator:
    """A name, not its place in a list, decides what is drawn."""
    return np.random.default_rng([seed, draw, *name.encode()])


def photographed(kinds: dict[str, Kind], name: str, seed: int, draw: int) -> dict[str, Figures]:
    """A kind under both patterns, with its dents; of `KINDS` without them too."""
    scene = kinds[name](generator(seed, draw, name))
    truth = scene.truth()
    rows = {}
    for code in CODES:
        one = scene.under(code)
        noise = generator(seed, draw, f'{name}/{code}')
        rows[code] = of_photograph(one, truth, noise)
        if kinds is KINDS:
            rows[f'{code}, no dents'] = of_photograph(one.bare(), None, noise)
        if kinds is PAPER and code == 'stripe':
            rows[PAPERS_METHOD] = of_photograph(one, truth, noise, method=PAPERS_METHOD)
    return rows
