"""Fringe orders on random surfaces: laps, gaps, windows, foreground, panels that do not touch.

python benchmarks/surfaces.py [--count 100] [--seed 1] [--code contrast] [--jobs 2]
                               [--only foreground]

A scene has one rig, a skin, clean or dirty, and one of the kinds, of random place, tilt and size,
in one of the lights. Coverage is that of the lit skin; a scene is wrong if more than a few points
are off by more than 0.35 fringes. Seed 1 is what constants were looked at with.
"""

from __future__ import annotations

import argparse
import multiprocessing
from collections import Counter
from dataclasses import dataclass, replace

import cv2
import numpy as np
from scenes import CLEAN, DAYLIGHT, FAR, FIELD, NEAR, PATTERN
from tqdm import tqdm

from ftp_dent_ros.errors import RefusedFrameError
from ftp_dent_ros.pattern.pattern import CODES
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.profilometry import Reconstructor, Settings
from ftp_dent_ros.rig.rig import Rig
from ftp_dent_ros.simulation import (
    Dirt,
    Motion,
    Opening,
    Paint,
    Panel,
    Photometry,
    Renderer,
    Surface,
)

# Rigs, and the distance that they are made for, metres.
RIGS = ((NEAR, 0.6), (FIELD, 0.8), (FAR, 1.2))
LIGHTS = {'clean': CLEAN, 'usual': {}, 'daylight': DAYLIGHT, 'moving': {}}
KINDS = 'lap along', 'lap across', 'lap aslant', 'gap', 'window', 'foreground', 'apart'
SPEED = 0.1  # metres a second, in an exposure of 10 ms
# Share of a fringe from which on a point is another fringe's, and points of one that count.
WRONG, FEW = 0.35, 50
# Every so many pixels of the cloud.
STRIDE = 2


@dataclass(frozen=True)
class Result:
    """What became of one scene."""

    number: int
    kind: str
    light: str
    lit: int
    covered: int
    wrong: int
    refused: str


def scene(number: int, seed: int) -> tuple[str, str, Rig, Surface, Photometry, Motion]:
    """One scene, by its number and the seed alone."""
    rng = np.random.default_rng([seed, number])
    rig, distance = RIGS[rng.integers(len(RIGS))]
    kind, light = str(rng.choice(KINDS)), str(rng.choice(list(LIGHTS)))
    distance *= rng.uniform(0.9, 1.1)
    # Depth from one fringe to the next.
    baseline = float(np.linalg.norm(rig.projector_centre))
    fringe = PATTERN.period_px * distance**2 / (rig.projector.camera_matrix[0, 0] * baseline)
    panels = _panels(kind, distance, fringe, rng)
    photometry = replace(Photometry(reference_distance=distance), **LIGHTS[light])
    motion = Motion(translation=np.array([0.01 * SPEED * (light == 'moving'), 0, 0]))
    return kind, light, rig, Surface(panels), photometry, motion


def _panels(
    kind: str, distance: float, fringe: float, rng: np.random.Generator
) -> tuple[Panel, ...]:
    """Panels of a kind: the skin, and what stands before, behind or beside it."""
    tilt = rng.uniform(-0.12, 0.12, 2)
    angles = {'lap along': 0.0, 'lap across': np.pi / 2, 'lap aslant': rng.uniform(0.2, 1.4)}
    turn = angles.get(kind, rng.uniform(-1.6, 1.6))
    tone = rng.uniform(0.25, 0.8)
    dirt = (Dirt(0.1, (0.012, 0.003), int(rng.integers(1 << 31)), 25, 1.5),)
    paint = Paint((tone, tone, tone), marks=dirt if rng.random() < 0.5 else ())
    pose = Pose.from_rpy((*tilt, turn), (0, 0, distance))

    def panel(extent, nearer=0.0, openings=()):
        moved = replace(pose, translation=pose.apply(np.array([0.0, 0.0, -nearer])))
        return Panel(moved, extent, paint=paint, openings=openings)

    edge = rng.uniform(-0.08, 0.08)
    whole = (-0.9, 0.9, -0.9, 0.9)
    before, beside = (-0.9, edge, -0.9, 0.9), (edge, 0.9, -0.9, 0.9)
    if kind.startswith('lap'):
        return panel(before, rng.uniform(0.0005, 0.005)), panel(beside)
    step = rng.uniform(-5, 5) * fringe
    if kind in ('gap', 'apart'):
        step *= 0.2 if kind == 'gap' else 1
        beside = (edge + rng.uniform(0.006, 0.03), 0.9, -0.9, 0.9)
        return panel(before), panel(beside, step)
    if kind == 'window':
        opening = Opening(edge, edge / 2, *rng.uniform(0.03, 0.12, 2), 0.0, rng.random() < 0.5)
        return (panel(whole, openings=(opening,)),)
    half = rng.uniform(0.03, 0.08, 2) * distance
    small = (edge - half[0], edge + half[0], -half[1], half[1])
    return panel(whole), panel(small, abs(step) + 0.5 * fringe)


def one(task: tuple[int, int, str]) -> Result:
    """Photograph and measure one scene."""
    number, seed, code = task
    cv2.setNumThreads(1)
    kind, light, rig, surface, photometry, motion = scene(number, seed)
    pattern = replace(PATTERN, code=code)
    rng = np.random.default_rng([seed, number, 1])
    image = Renderer(rig, pattern.draw(), photometry).render(surface, rng, motion)
    rays = rig.camera.rays(rig.camera.pixel_grid())[::STRIDE, ::STRIDE]
    points = rays * surface.intersect(rays)[..., None]
    u, v = np.moveaxis(rig.projector.project(rig.to_projector(points)), -1, 0)
    lit = (u > 0) & (u < pattern.width - 1) & (v > 0) & (v < pattern.height - 1)
    # What stands between it and the projector takes the light away.
    way = points - rig.projector_centre
    lit &= surface.intersect(np.nan_to_num(way, nan=1.0), rig.projector_centre) > 1 - 3e-4
    known = number, kind, light, int(lit.sum())
    try:
        cloud = Reconstructor(rig, pattern, Settings(stride=STRIDE)).measure(image).cloud
    except RefusedFrameError as reason:
        return Result(*known, 0, 0, str(reason.reason))
    seen = rig.projector.project(rig.to_projector(cloud.points))[..., 0]
    off = np.abs(seen - u)[cloud.valid] / pattern.period_px
    return Result(*known, int((cloud.valid & lit).sum()), int(np.count_nonzero(off > WRONG)), '')


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--count', type=int, default=100)
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--code', choices=CODES, default='contrast')
    parser.add_argument('--jobs', type=int, default=1)
    parser.add_argument('--only', choices=KINDS, help='the scenes of one kind')
    arguments = parser.parse_args()
    tasks = [
        (number, arguments.seed, arguments.code)
        for number in range(arguments.count)
        if arguments.only in (None, scene(number, arguments.seed)[0])
    ]
    with multiprocessing.get_context('spawn').Pool(arguments.jobs) as pool:
        results = list(tqdm(pool.imap_unordered(one, tasks), total=len(tasks), unit='scene'))
    print(f'code {arguments.code}, seed {arguments.seed}, {len(results)} scenes')
    print(f'{"":14}{"scenes":>8}{"coverage %":>12}{"wrong scenes":>14}{"refused":>9}')
    groups = {kind: [r for r in results if r.kind == kind] for kind in KINDS}
    groups |= {light: [r for r in results if r.light == light] for light in LIGHTS}
    for name, group in {**groups, 'all': results}.items():
        if not group:
            continue
        coverage = 100 * sum(r.covered for r in group) / sum(r.lit for r in group)
        wrong = sum(r.wrong > FEW for r in group)
        refused = sum(bool(r.refused) for r in group)
        print(f'{name:14}{len(group):8}{coverage:12.1f}{wrong:14}{refused:9}')
    for r in sorted(results, key=lambda r: -r.wrong)[:20]:
        if r.wrong > FEW:
            print(f'scene {r.number} ({r.kind}, {r.light}): {r.wrong} points of another fringe')
    for reason, count in Counter(r.refused for r in results if r.refused).items():
        print(f'refused {count}: {reason}')


if __name__ == '__main__':
    main()
