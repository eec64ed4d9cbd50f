"""Kinds that nothing was built on, by another renderer: what is published, and whether it is so.

python benchmarks/outside.py [--only wet] [--seeds 2] [--first-seed 0] [--held] [--details]
                             [--calibrated]

A row a kind, the worst of its photographs but for coverage and the median error. Errors over
sigma are those of all points ("z": root mean square; "<4": per cent below 4) and of those more
than two fringes away from a step, a shadow or the light's rim ("inner"). "order" counts points
that are wrong by more than 0.4 fringes, "dents" those found of those in view, "flat" the dents of
0.2 mm and more that the cloud shows flatter by more than two sigma, "false" the dents, bumps,
creases and gouges that are none, "other" what is listed without a name.
"""

from __future__ import annotations

import argparse
import math
import os
from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from attempts import attempt
from numpy.typing import NDArray
from outside_calibration import calibrated
from outside_kinds import HELD, MENDING
from outside_panels import Outside
from outside_parts import Dimple
from outside_renderer import World
from tqdm import tqdm

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.inspection.measuring.inspection import inspect
from ftp_dent_ros.pattern.pattern import CODES
from ftp_dent_ros.profilometry import Reconstructor, Settings
from ftp_dent_ros.profilometry.measurement import Measurement

# Fringes from an edge of the surface within which errors are told apart.
_EDGE = 2.0
# Depth that changes by more between pixels, beyond what its slope explains, is a step, metres.
_STEP = 3e-4
# A dent whose depth is told here must be right in the cloud, metres.
_WHOLE = 0.2e-3
_NAMED = 'dent', 'bump', 'crease', 'gouge'


@dataclass
class Outcome:
    """What became of one photograph."""

    kind: str
    seed: int
    refused: str = ''
    crashed: str = ''
    remarks: tuple[str, ...] = ()
    covered: float = math.nan
    error: float = math.nan  # median of the absolute error, mm
    spread: float = math.nan
    below4: float = math.nan
    inner_spread: float = math.nan
    inner_below4: float = math.nan
    order: int = 0
    found: int = 0
    dents: int = 0
    flat: list[str] = field(default_factory=list)
    false: list[str] = field(default_factory=list)
    other: list[str] = field(default_factory=list)

    @property
    def amiss(self) -> tuple[str, ...]:
        """What was published and is not so."""
        words = []
        if self.crashed:
            words.append('CRASH')
        if self.inner_spread > 1.4 or self.inner_below4 < 0.99:
            words.append('sigma')
        elif self.spread > 1.4 or self.below4 < 0.99:
            words.append('sigma at edges')
        words += ['order'] * (self.order > 0) + ['flat'] * bool(self.flat)
        return (*words, *['false'] * bool(self.false))


def truth(world: World, stride: int) -> tuple[NDArray, NDArray[np.bool_], NDArray]:
    """Depth of what a pixel shows, whether the projector lights it, and pixels to an edge."""
    camera = world.rig.camera
    shape = camera.height, camera.width
    grid = camera.pixel_grid().reshape(-1, 2)
    points, _, what = world.seen(camera.rays(grid), world.begun(grid[:, 1]))
    depth = points[:, 2].reshape(shape)
    hits = world.hits(np.nan_to_num(points, nan=1.0), np.zeros_like(points), points[:, 0], 0.0)
    lit = (hits.u > 0) & (hits.u < world.pattern.width - 1) & (hits.v > 0)
    lit &= (hits.v < world.pattern.height - 1) & (what >= 0)
    lit = (lit & ~world.shadow(np.nan_to_num(points, nan=1.0))).reshape(shape)
    edge = cv2.morphologyEx(lit.astype(np.uint8), cv2.MORPH_GRADIENT, np.ones((3, 3))) > 0
    filled = np.nan_to_num(depth)
    for axis in (0, 1):
        bend = np.abs(np.diff(filled, 2, axis=axis)) > _STEP
        edge |= np.pad(bend, [(1, 1) if a == axis else (0, 0) for a in (0, 1)])
    edge[[0, -1]] = edge[:, [0, -1]] = True
    far = cv2.distanceTransform((~edge).astype(np.uint8), cv2.DIST_L2, 5)
    return depth[::stride, ::stride], lit[::stride, ::stride], far[::stride, ::stride]


def outcome(
    kind: str, seed: int, code: str, calibration: bool = False, stride: int = 1
) -> Outcome:
    """Photograph a kind by a seed, measure it, by a calibrated rig or not, and compare."""
    rng = np.random.default_rng([seed, *kind.encode()])
    outside = (MENDING | HELD)[kind](rng)
    world = outside.world
    world = replace(world, pattern=replace(world.pattern, code=code))
    outside, result = replace(outside, world=world), Outcome(kind, seed)
    picture = outside.picture(rng)
    settings = Settings(stride=stride)
    rig = calibrated(world, seed) if calibration else world.rig

    def measured() -> Measurement:
        return Reconstructor(rig, world.pattern, settings).measure(picture)

    measurement = attempt(measured, result)
    if measurement is None:
        return result
    cloud, result.remarks = measurement.cloud, measurement.coverage.remarks
    _points(result, outside, cloud, stride)
    found = attempt(lambda: inspect(cloud), result)
    if found is None:
        return result
    _dents(result, world, cloud, stride, (*found.dents, *found.others))
    return result


def _points(result: Outcome, outside: Outside, cloud: Cloud, stride: int) -> None:
    world = outside.world
    depth, lit, far = truth(world, stride)
    valid = cloud.valid & np.isfinite(depth)
    result.covered = float((valid & lit).sum() / max(lit.sum(), 1))
    rays = world.rig.camera.rays(world.rig.camera.pixel_grid(stride))
    along = np.linalg.norm(rays, axis=-1)
    error = (cloud.points[..., 2] - depth) * along
    fringe_px = world.pattern.period_px * world.rig.camera.camera_matrix[0, 0] / 1890.0
    baseline = float(np.linalg.norm(world.rig.projector_centre))
    order = depth**2 * world.pattern.period_px / 1890.0 / baseline
    result.order = int((np.abs(error) > 0.4 * order)[valid].sum())
    result.error = 1e3 * float(np.median(np.abs(error[valid]))) if valid.any() else math.nan
    ratio = error / cloud.sigma
    result.spread, result.below4 = _normalised(ratio[valid])
    inner = valid & (far > _EDGE * fringe_px) & lit
    result.inner_spread, result.inner_below4 = _normalised(ratio[inner])


def _normalised(ratio: NDArray) -> tuple[float, float]:
    if len(ratio) < 100:
        return math.nan, math.nan
    return float(np.sqrt(np.mean(ratio**2))), float(np.mean(np.abs(ratio) < 4))


def _dents(result: Outcome, world: World, cloud: Cloud, stride: int, listed) -> None:
    taken: set[int] = set()
    grid = np.stack(np.meshgrid(*(np.arange(n) for n in cloud.valid.shape[::-1])), axis=-1)
    for dimple in world.dimples:
        place = np.array([dimple.x, dimple.y])
        bare = World.depth(world, *place)
        (pixel,) = world.rig.camera.project(np.array([[*place, bare]])) / stride
        focal = world.rig.camera.camera_matrix[0, 0] / stride
        reach = max(1.0, 0.05 * dimple.width * focal / bare)
        near = (np.linalg.norm(grid - pixel, axis=-1) <= reach) & cloud.valid
        mine = [
            (float(np.linalg.norm(m.position[:2] - place)), i)
            for i, m in enumerate(listed)
            if m.kind != 'step' and _on(dimple, m.position[:2])
        ]
        taken.update(i for _, i in mine)
        if not _in_view(world, dimple):
            continue
        result.dents += 1
        result.found += bool(mine)
        if near.sum() < 3 or dimple.depth < _WHOLE:
            continue
        points = cloud.points[near].astype(float)
        moment = world.begun(stride * grid[near][:, 1])
        error = float(np.mean(points[:, 2] - world.depth(points[:, 0], points[:, 1], moment)))
        sigma = float(np.sqrt(np.mean(cloud.sigma[near].astype(float) ** 2)))
        if -error > 2 * sigma:
            result.flat.append(
                f'{1e3 * dimple.depth:.2f} by {-1e3 * error:.3f}: {-error / sigma:.1f} u'
            )
    for i, m in enumerate(listed):
        text = (
            f'{m.kind} {1e3 * m.depth.value:.3f}+-{1e3 * m.depth.uncertainty:.3f} at '
            f'{np.round(1e3 * m.position[:2]).astype(int).tolist()}'
        )
        at_thing = any(
            math.hypot(*(m.position[:2] - (x, y))) < r + 0.003 for x, y, r in world.things
        )
        if i in taken or at_thing or m.kind == 'step':
            continue
        (result.false if m.kind in _NAMED else result.other).append(text)


def _on(dimple: Dimple, place: NDArray) -> bool:
    """Whether a place is within a dent's outline, or up to a centimetre beside."""
    reach = max(dimple.length, dimple.width) / 2 + 0.01
    return bool(math.hypot(place[0] - dimple.x, place[1] - dimple.y) < reach)


def _in_view(world: World, dimple: Dimple) -> bool:
    """Whether a dent's outline is lit and seen as a whole."""
    turns = np.linspace(0, 2 * math.pi, 48)
    along, across = dimple.length / 2 * np.cos(turns), dimple.width / 2 * np.sin(turns)
    x = dimple.x + along * math.cos(dimple.angle) - across * math.sin(dimple.angle)
    y = dimple.y + along * math.sin(dimple.angle) + across * math.cos(dimple.angle)
    z = world.depth(x, y)
    points = np.stack([x, y, z], axis=-1)
    camera, projector = world.rig.camera, world.rig.projector
    u, v = camera.project(points).T
    up, vp = projector.project(world.rig.to_projector(points)).T
    seen = (u > 0) & (u < camera.width - 1) & (v > 0) & (v < camera.height - 1)
    seen &= (up > 0) & (up < projector.width - 1) & (vp > 0) & (vp < projector.height - 1)
    return bool((seen & ~world.shadow(points)).all())


def row(some: list[Outcome]) -> str:
    """A kind, over its photographs."""
    measured = [r for r in some if not math.isnan(r.covered)]
    if not measured:
        return f'{"":>8}{some[0].crashed or some[0].refused}'
    worst = {
        name: max((getattr(r, name) for r in measured), key=np.nan_to_num)
        for name in ('spread', 'inner_spread')
    }
    least = {
        name: np.nanmin([getattr(r, name) for r in measured])
        for name in ('below4', 'inner_below4')
    }
    cells = (
        f'{100 * np.mean([r.covered for r in measured]):.1f}',
        f'{np.nanmean([r.error for r in measured]):.4f}',
        f'{worst["spread"]:.2f}',
        f'{100 * least["below4"]:.1f}',
        f'{worst["inner_spread"]:.2f}',
        f'{100 * least["inner_below4"]:.1f}',
        str(sum(r.order for r in measured)),
        f'{sum(r.found for r in measured)}/{sum(r.dents for r in measured)}',
        *(
            str(sum(len(getattr(r, name)) for r in measured))
            for name in ('flat', 'false', 'other')
        ),
    )
    amiss = dict.fromkeys(word for r in some for word in r.amiss)
    return ''.join(f'{cell:>9}' for cell in cells) + f'  {", ".join(amiss)}'


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--only', default='', help='parts of names of kinds, with commas between')
    parser.add_argument('--held', action='store_true', help='the kinds that are held out')
    parser.add_argument('--seeds', type=int, default=1, help='photographs a kind')
    parser.add_argument('--first-seed', type=int, default=0)
    parser.add_argument('--code', choices=CODES, default='stripe', help='of the pattern')
    parser.add_argument(
        '--calibrated', action='store_true', help="the projector's column by a plain panel"
    )
    parser.add_argument('--details', action='store_true', help='all that is amiss')
    parser.add_argument('--save', help='folder that pictures go to, to be looked at')
    arguments = parser.parse_args()
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
    cv2.setNumThreads(1)
    kinds = [
        name
        for name in (HELD if arguments.held else MENDING)
        if any(part in name for part in arguments.only.split(','))
    ]
    columns = (
        'cover',
        'error',
        'z',
        '<4',
        'inner z',
        '<4',
        'order',
        'dents',
        'flat',
        'false',
        'other',
    )
    lines = [f'{"":18}' + ''.join(f'{column:>9}' for column in columns) + '  amiss']
    for name in tqdm(kinds, unit='kind'):
        seeds = range(arguments.first_seed, arguments.first_seed + arguments.seeds)
        some = [outcome(name, seed, arguments.code, arguments.calibrated) for seed in seeds]
        lines.append(f'{name:18}{row(some)}')
        for r in some if arguments.details else ():
            told = (r.crashed, r.refused, *r.remarks)
            lines += [f'{"":22}{r.seed} told: {text}' for text in told if text]
            for what in ('flat', 'false', 'other'):
                lines += [f'{"":22}{r.seed} {what}: {text}' for text in getattr(r, what)]
        if arguments.save:
            _save(arguments.save, name, arguments.first_seed)
    print('\n'.join(lines))


def _save(folder: str, kind: str, seed: int) -> None:
    rng = np.random.default_rng([seed, *kind.encode()])
    picture = (MENDING | HELD)[kind](rng).picture(rng)
    os.makedirs(folder, exist_ok=True)
    cv2.imwrite(os.path.join(folder, f'{kind}.jpg'), picture[..., ::-1])


if __name__ == '__main__':
    main()
