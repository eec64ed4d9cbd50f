"""Every kind of camera and what disturbs it: error against the clean photograph, error over sigma.

python benchmarks/cameras.py [--code contrast] [--only raw] [--seeds 4] [--jobs 2]
python benchmarks/cameras.py --first 1000     # the hold-out: look at it last, choose nothing on it

A row a camera, over its seeds: coverage of the lit surface, mean absolute error, its ratio to that
of the first row (eight bits, demosaiced) on the same scenes, of all and of what lies four fringes
and more from an edge of paint, standard deviation of error over sigma, the worst of the scenes'
own in brackets, and how many photographs were refused. The scenes differ by seed: distance, tilt,
curvature, waves of paint, dents, albedo.
"""

from __future__ import annotations

import argparse
import multiprocessing
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import cv2
import numpy as np
from tqdm import tqdm

from ftp_dent_ros.errors import FtpDentError
from ftp_dent_ros.files import find
from ftp_dent_ros.pattern.file import read_pattern
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.profilometry import Reconstructor, Settings
from ftp_dent_ros.rig.rig import Rig, read_rig
from ftp_dent_ros.simulation import Dent, Motion, Paint, Panel, Photometry, Renderer, Surface

RED, BLUE = (0.6, 0.06, 0.05), (0.05, 0.12, 0.5)
# A mosaic's camera: no colour is seen at every pixel.
MOSAIC: dict[str, Any] = {'bayer': True}
RAW12: dict[str, Any] = {'encoding': 'bayer_rggb12'}


# Metres from an edge of paint, four fringes, beyond which no window sees it.
AWAY = 0.022


@dataclass(frozen=True)
class Camera:
    """What is changed of a clean photograph: sensor, paint, motion, place of the stripe."""

    light: dict[str, Any]
    albedo: tuple[float, float, float] | None = None
    stripes: tuple[float, float, float] | None = None
    moved_px: float = 0.0
    stripe_away: bool = False
    told: bool = False  # the camera's curve, in rig.yaml


CAMERAS = {
    'demosaiced 8': Camera(MOSAIC),
    'raw 8': Camera({'encoding': 'bayer_rggb8'}),
    'raw 10': Camera({'encoding': 'bayer_gbrg10'}),
    'raw 12': Camera(RAW12),
    'mono 8': Camera({'encoding': 'mono8'}),
    'mono 12': Camera({'encoding': 'mono12'}),
    'rgb 16': Camera({'encoding': 'rgb16'}),
    'JPEG 90': Camera({**MOSAIC, 'jpeg_quality': 90}),
    'JPEG 30': Camera({**MOSAIC, 'jpeg_quality': 30}),
    'mono JPEG 30': Camera({'encoding': 'mono8', 'jpeg_quality': 30}),
    'blur 3 px': Camera(MOSAIC, moved_px=3.0),
    'blur 3 px, raw 12': Camera(RAW12, moved_px=3.0),
    'crosstalk 20 %': Camera({**MOSAIC, 'crosstalk': 0.2}),
    'crosstalk, raw 12': Camera({**RAW12, 'crosstalk': 0.2}),
    'red paint': Camera(MOSAIC, RED),
    'red paint, raw 12': Camera(RAW12, RED),
    'blue paint': Camera(MOSAIC, BLUE),
    'blue paint, raw 12': Camera(RAW12, BLUE),
    'striped paint': Camera(MOSAIC, stripes=RED),
    'striped paint, raw 12': Camera(RAW12, stripes=RED),
    'stripe out of view': Camera(MOSAIC, stripe_away=True),
    'dim 8': Camera({**MOSAIC, 'exposure': 0.15, 'read_noise': 0.2}),
    'dim raw 12': Camera({**RAW12, 'exposure': 0.15, 'read_noise': 0.2}),
    'gamma 2.2': Camera({**MOSAIC, 'camera_gamma': 2.2}),
    'gamma 2.2, told': Camera({**MOSAIC, 'camera_gamma': 2.2}, told=True),
}


@dataclass(frozen=True)
class Result:
    """One photograph."""

    camera: str
    seed: int
    coverage: float = 0.0
    error: float = float('nan')  # metres
    spread: float = float('nan')
    away: float = float('nan')  # metres, of what lies `AWAY` from an edge of paint
    refused: str = ''


def scene(rig: Rig, seed: int, camera: Camera) -> Surface:
    """A skin of the seed, in the camera's frame."""
    rng = np.random.default_rng([seed, 20])
    distance = rng.uniform(0.7, 0.95)
    pose = Pose.from_rpy((*rng.uniform(-0.2, 0.2, 2), rng.uniform(-0.3, 0.3)), (0, 0, distance))
    dents = tuple(
        Dent(
            *rng.uniform(-0.12, 0.12, 2),
            length=rng.uniform(0.03, 0.08),
            width=rng.uniform(0.02, 0.05),
            depth=rng.uniform(2e-4, 2e-3),
            angle=rng.uniform(0, 3),
        )
        for _ in range(3)
    )
    albedo = (float(rng.uniform(0.4, 0.85)),) * 3
    radius = float(rng.uniform(1.2, 4.0))
    side = 0.14 if camera.stripe_away else 0.0
    paint = Paint(camera.albedo or albedo)
    if camera.stripes:
        # Its edge crosses the fringes, and the stripe of a red pattern, aslant.
        angle = rng.uniform(-0.5, 0.5)
        edge = np.cos(angle), np.sin(angle), rng.uniform(-0.03, 0.03)
        paint = replace(paint, edge=edge, albedo_beyond=camera.stripes)
    half = 0.16 if camera.stripe_away else 0.25
    extent = (side - half if not side else 0.03, half, -0.25, 0.25)
    panel = Panel(pose, extent, dents=dents, paint=paint, cylinder_radius=radius)
    return Surface((panel,))


def one(task: tuple[str, int], code: str) -> Result:
    """Reconstruct a photograph of a camera of `CAMERAS`."""
    name, seed = task
    cv2.setNumThreads(1)
    camera = CAMERAS[name]
    rig = read_rig(find('shipped:rig.yaml'))
    pattern: Pattern = replace(read_pattern(find('shipped:pattern.yaml')), code=code)
    surface = scene(rig, seed, camera)
    light = Photometry(reference_distance=0.8, samples=16, **camera.light)
    motion = None
    if camera.moved_px:
        distance = surface.panels[0].pose.translation[2]
        way = camera.moved_px * distance / rig.camera.camera_matrix[0, 0]
        motion = Motion(translation=np.array([way, 0.0, 0.0]))
    renderer = Renderer(rig, pattern.draw(), light)
    photograph = renderer.photograph(surface, np.random.default_rng([seed, 21]), motion)
    if camera.told:
        rig = replace(rig, response=np.linspace(0, 1, 256) ** light.camera_gamma)
    try:
        cloud = Reconstructor(rig, pattern, Settings(stride=3)).measure(photograph).cloud
    except FtpDentError as reason:
        return Result(name, seed, refused=str(reason))
    points = cloud.points[cloud.valid].astype(float)
    error = surface.distance(points)
    seen = surface.intersect(rig.camera.rays(rig.camera.pixel_grid(3)))
    x, y, _ = surface.panels[0].pose.inverse().apply(points).T
    along_u, along_v, offset = surface.panels[0].paint.edge
    away = np.abs(along_u * x + along_v * y - offset) > AWAY
    points = rig.camera.rays(rig.camera.pixel_grid(3)) * seen[..., None]
    u, v = np.moveaxis(rig.projector.project(rig.to_projector(points)), -1, 0)
    lit = (u > 2) & (u < pattern.width - 3) & (v > 2) & (v < pattern.height - 3)
    return Result(
        name,
        seed,
        float((cloud.valid & lit).sum() / lit.sum()),
        float(np.abs(error).mean()),
        float((error / cloud.sigma[cloud.valid]).std()),
        float(np.abs(error[away]).mean()),
    )


def rows(results: list[Result]) -> Iterator[str]:
    """The table."""
    by_name: dict[str, list[Result]] = {}
    for each in results:
        by_name.setdefault(each.camera, []).append(each)
    first = {each.seed: each.error for each in next(iter(by_name.values()))}
    yield '| camera | coverage | MAE | against the first | off edges | error / sigma | refused |'
    yield '| --- | --- | --- | --- | --- | --- | --- |'
    for name, some in by_name.items():
        got = [each for each in some if not each.refused]
        if not got:
            yield f'| {name} | | | | | | all: {some[0].refused} |'
            continue
        ratio, away = (
            np.median([error(each) / first[each.seed] for each in got])
            for error in (lambda each: each.error, lambda each: each.away)
        )
        spreads = np.array([each.spread for each in got])
        worst = spreads[np.argmax(np.abs(np.log(spreads)))]
        yield (
            f'| {name} | {100 * np.mean([each.coverage for each in got]):.1f} % '
            f'| {1e6 * np.mean([each.error for each in got]):.1f} um | {ratio:.2f} | {away:.2f} '
            f'| {np.sqrt(np.mean(spreads**2)):.2f} ({worst:.2f}) | {len(some) - len(got)} |'
        )


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or '').partition('\n')[0])
    parser.add_argument('--code', default='stripe', choices=['stripe', 'contrast'])
    parser.add_argument('--only', default='', help='cameras whose names hold this')
    parser.add_argument('--seeds', type=int, default=4)
    parser.add_argument('--first', type=int, default=0, help='first seed; the hold-out: 1000')
    parser.add_argument('--jobs', type=int, default=2)
    arguments = parser.parse_args()
    names = [n for i, n in enumerate(CAMERAS) if i == 0 or arguments.only in n]
    seeds = range(arguments.first, arguments.first + arguments.seeds)
    tasks = [(name, seed) for name in names for seed in seeds]
    with multiprocessing.Pool(arguments.jobs) as pool:
        work = pool.imap(partial(one, code=arguments.code), tasks)
        results = list(tqdm(work, total=len(tasks)))
    print('\n'.join(rows(results)))


if __name__ == '__main__':
    main()
