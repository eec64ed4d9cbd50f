"""Clouds of simulated flights joined to one skin, against where they truly were.

python benchmarks/survey.py [--only pairs strip passes flying bare bad coverage]
                            [--seed 300] [--skins 3] [--clouds 40] [--length 6]

Photographs are rendered and reconstructed at stride 2 of 720p; the autopilot errs by 3 cm and 0.9
degrees, and forgets its error in 10 s. Nothing was chosen on seeds from 300 on.

pairs     neighbouring clouds on skins with rivets, dirt, scratches and letters
strip     a strip of 2 m: places seen from its middle, what is stated of them, processor time
passes    three passes of 6 m, there and back, that overlap by 30 %: the same; memory
flying    each pose in the map as the node survey publishes it, by what it states; processor time
bare      1 m of smooth, unmarked skin between marked ends: errors by what is stated
bad       one pair forced 25 mm off in a strip: left out, and the others not bent
coverage  two passes with a gap of 20 mm: cells against the truth, and the gap
"""

from __future__ import annotations

import argparse
import resource
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.files import find
from ftp_dent_ros.pattern.file import read_pattern
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.profilometry import Reconstructor, Settings
from ftp_dent_ros.rig.rig import read_rig
from ftp_dent_ros.simulation import Dent, Paint, Panel, Photometry, Renderer, Rivet, Surface
from ftp_dent_ros.simulation.paint import Dirt, Lettering, scratches
from ftp_dent_ros.survey.information import COMMON
from ftp_dent_ros.survey.joining import Joining
from ftp_dent_ros.survey.mosaic import Mosaic
from ftp_dent_ros.survey.patch import patch_of
from ftp_dent_ros.survey.registration import register
from ftp_dent_ros.survey.unrolled import Unrolled

sys.path.append(str(Path(__file__).resolve().parents[1] / 'test'))
from flown_skin import STATED, erring

DISTANCE, STEP = 0.8, 0.045
WIDTH = 1.2
HALF_S = 500_000_000
MM = 1e3


def skin(
    seed: int, length: float, bare: tuple[float, float] | None = None, half: float = 0.2
) -> list[Panel]:
    """Panels of a fuselage along y, marked so far to either side; or bare between two places."""
    rng = np.random.default_rng(seed)
    low, high = -0.6, length + 0.6
    parts = [(low, high)] if bare is None else [(low, bare[0]), (bare[1], high)]
    radius = float(rng.uniform(1.5, 3.0))
    marks, rivets = [], []
    for begin, end in parts:
        extent = (-half, half, begin, end)
        marks += [*scratches(int(25 * (end - begin)), extent, seed)]
        y = float(rng.uniform(begin, end))
        marks.append(Lettering(0.03, y, 'NO STEP', 0.02, (0.4, 0.4, 0.4), 1.57))
        for x in rng.uniform(0.07 - half, half - 0.07, round(10 * half)):
            rivets += [Rivet(float(x), y) for y in np.arange(begin, end, 0.025)]
    if bare is None:
        marks.append(Dirt(float(rng.uniform(0.03, 0.12)), seed=seed))
    dents = [] if bare else _dents(rng, length, half)
    paint = Paint(albedo=float(rng.uniform(0.4, 0.8)), roughness=0.3, marks=tuple(marks))
    extent = (-WIDTH / 2, WIDTH / 2, low, high)
    frame = Pose(Rotation.identity(), np.zeros(3))
    return [Panel(frame, extent, radius, paint, tuple(dents), tuple(rivets))]


def _dents(rng: np.random.Generator, length: float, half: float) -> list[Dent]:
    return [
        Dent(
            float(rng.uniform(0.08 - half, half - 0.08)),
            float(rng.uniform(0, length)),
            float(rng.uniform(0.015, 0.06)),
            float(rng.uniform(0.015, 0.05)),
            float(rng.uniform(2e-4, 1e-3)),
            float(rng.uniform(0, 3)),
        )
        for _ in range(int(30 * half * length) + 1)
    ]


def flight(seed: int, count: int, step: float = STEP, x: float = 0.0) -> list[Pose]:
    """True poses of the camera along y, with sway and wobble."""
    rng = np.random.default_rng([seed, 5])
    along = Rotation.from_euler('z', np.pi / 2)
    poses = []
    for index in range(count):
        sway, wobble = rng.normal(0, 0.006, 3), rng.normal(0, 0.008, 3)
        place = np.array([x, step * index, -DISTANCE]) + sway
        poses.append(Pose(along * Rotation.from_rotvec(wobble), place))
    return poses


@cache
def _devices() -> tuple[Renderer, Reconstructor]:
    rig, pattern = read_rig(find('shipped:rig.yaml')), read_pattern(find('shipped:pattern.yaml'))
    light = Photometry(reference_distance=DISTANCE)
    return Renderer(rig, pattern.draw(), light), Reconstructor(rig, pattern, Settings(stride=2))


def clouds(
    panels: list[Panel], poses: list[Pose], seed: int
) -> Iterator[tuple[Cloud, NDArray[np.uint8]]]:
    """Cloud and skin image of each pose."""
    renderer, reconstructor = _devices()
    for index, pose in enumerate(poses):
        seen = Surface(tuple(panels)).transformed(pose.inverse())
        image = renderer.render(seen, np.random.default_rng([seed, index]))
        measured = reconstructor.measure(image, skin=True)
        assert measured.cloud.skin is not None
        yield measured.cloud, measured.cloud.skin


def joined(panels: list[Panel], poses: list[Pose], seed: int) -> tuple[Joining, float]:
    """A flight joined, and the processor time that each cloud took."""
    joining, spent = Joining(), 0.0
    stated = erring(poses, seed)
    for index, (cloud, image) in enumerate(clouds(panels, poses, seed)):
        started = time.process_time()
        joining.add(index * HALF_S, cloud, image, stated[index], STATED)
        spent += time.process_time() - started
    joining.finish()
    return joining, spent / len(poses)


def pairs(arguments: argparse.Namespace) -> None:
    errors, normalised = [], []
    for seed in range(arguments.seed, arguments.seed + arguments.skins):
        poses = flight(seed, 4)
        patches = [patch_of(*each) for each in clouds(skin(seed, 0.3), poses, seed)]
        rng = np.random.default_rng([seed, 9])
        for first, second in ((0, 1), (1, 2), (2, 3), (0, 2), (1, 3)):
            true = poses[first].inverse() @ poses[second]
            doubt = STATED / 4
            off = rng.multivariate_normal(np.zeros(6), doubt)
            guess = Pose(Rotation.from_rotvec(off[3:]) * true.rotation, true.translation + off[:3])
            found = register(patches[first], patches[second], guess, doubt)
            error = found.error(true)
            if found.told < 6:
                print(f'  skin {seed}, {first}-{second}: {found.told} told; {found.remark}')
                continue
            errors.append(np.abs(error))
            stated = np.linalg.inv(found.information) + found.common @ COMMON @ found.common.T
            normalised.append(error @ np.linalg.solve(stated, error) / 6)
    along, normal, turn = np.array(errors)[:, :2], np.array(errors)[:, 2], np.array(errors)[:, 3:]
    print(
        f'pairs: {len(errors)}; medians {MM * np.median(normal):.4f} mm along the normal, '
        f'{MM * np.median(along):.3f} mm along the skin, {np.degrees(np.median(turn)):.4f} '
        f'degrees; largest {MM * normal.max():.4f} mm, {MM * along.max():.3f} mm; normalised '
        f'error {np.sqrt(np.mean(normalised)):.2f}'
    )


def strip(arguments: argparse.Namespace) -> None:
    seed, count = arguments.seed + 20, arguments.clouds
    poses = flight(seed, count)
    joining, spent = joined(skin(seed, STEP * count), poses, seed)
    _tell('strip', joining, poses, spent)


def passes(arguments: argparse.Namespace) -> None:
    seed, count = arguments.seed + 160, round(arguments.length / STEP)
    poses = []
    # A cloud is 0.34 m across.
    for number, x in enumerate((-0.24, 0.0, 0.24)):
        poses += flight(seed + number, count, x=x)[:: -1 if number % 2 else 1]
    joining, spent = joined(skin(seed, STEP * count, half=0.45), poses, seed)
    _tell('passes', joining, poses, spent)


def _tell(name: str, joining: Joining, poses: list[Pose], spent: float) -> None:
    errors, normalised, distances = seen_from_the_middle(joining, poses)
    across = np.linalg.norm(errors[:, :3], axis=1)
    for reach in (0.5, 1.0, 9.0):
        near = distances < reach
        print(
            f'{name}: seen from the middle, up to {min(reach, distances.max()):.2f} m away: '
            f'places off by {MM * across[near].max():.3f} mm at most'
        )
    # Of the skin below the cameras.
    found, true = (
        np.stack([pose.apply(np.array([0, 0, DISTANCE])) for pose in each])
        for each in (joining.graph.poses, poses)
    )
    apart = [np.linalg.norm(each[:, None] - each, axis=-1) for each in (true, found)]
    off = np.abs(apart[1] - apart[0])
    for low, high in ((0.0, 1.0), (1.0, 9.0)):
        of = (apart[0] > low) & (apart[0] <= high)
        if of.any():
            print(
                f'{name}: distances on the skin up to {apart[0][of].max():.2f} m are off by '
                f'{MM * np.median(off[of]):.3f} mm (median), {MM * off[of].max():.3f} mm at most'
            )
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    misfit = np.median([link.relative.misfit for link in joining.graph.links])
    print(
        f'{name}: {len(poses)} clouds, {len(joining.graph.links)} pairs, '
        f'{len(joining.graph.left_out)} left out; normalised error '
        f'{np.sqrt(np.mean(normalised)):.2f}; overlaps agree to {MM * misfit:.4f} mm along the '
        f'normal; {MM * spent:.0f} ms of processor time a cloud; {memory:.0f} MB in all',
        flush=True,
    )


def flying(arguments: argparse.Namespace) -> None:
    misfits, spent = [], []
    for seed in range(arguments.seed + 120, arguments.seed + 120 + arguments.skins):
        poses = flight(seed, arguments.clouds)
        stated, joining = erring(poses, seed), Joining()
        panels = skin(seed, STEP * len(poses))
        for index, (cloud, image) in enumerate(clouds(panels, poses, seed)):
            started = time.process_time()
            pose = joining.add(index * HALF_S, cloud, image, stated[index], STATED)
            covariance = joining.newest_covariance()
            spent.append(time.process_time() - started)
            turn = (pose.rotation * poses[index].rotation.inv()).as_rotvec()
            error = np.concatenate([pose.translation - poses[index].translation, turn])
            misfits.append(error @ np.linalg.solve(covariance, error) / 6)
    print(
        f'flying: {len(misfits)} clouds of {arguments.skins} flights; normalised error of each '
        f'pose as it was published {np.sqrt(np.mean(misfits)):.2f}; processor time a cloud '
        f'{MM * np.median(spent):.0f} ms, at most {MM * max(spent):.0f} ms'
    )


def bare(arguments: argparse.Namespace) -> None:
    seed = arguments.seed + 40
    poses = flight(seed, 18, step=0.1)
    panels = skin(seed, 1.7, bare=(0.35, 1.35))
    joining, _ = joined(panels, poses, seed)
    errors, normalised, _ = seen_from_the_middle(joining, poses, anchor=0)
    spread = np.sqrt(np.trace(joining.graph.covariances(anchor=0)[-1, :3, :3]))
    off = np.linalg.norm(errors[-1, :3])
    told = [link.relative.told for link in joining.graph.links]
    print(
        f'bare: the far end, seen from the first, is off by {MM * off:.1f} mm, stated '
        f'{MM * spread:.1f} mm; normalised error {np.sqrt(np.mean(normalised)):.2f}; '
        f'{sum(each < 6 for each in told)} of {len(told)} pairs do not tell all'
    )


def bad(arguments: argparse.Namespace) -> None:
    seed = arguments.seed + 60
    poses = flight(seed, 8)
    joining, _ = joined(skin(seed, 0.4), poses, seed)
    graph = joining.graph
    before = list(graph.poses)
    index = next(i for i, link in enumerate(graph.links) if (link.first, link.second) == (3, 4))
    link = graph.links[index]
    wrong = Pose(Rotation.identity(), np.array([0.025, 0.0, 0.0])) @ link.relative.pose
    graph.links[index] = replace(link, relative=replace(link.relative, pose=wrong))
    joining.finish()
    moved = max(
        np.linalg.norm(a.translation - b.translation)
        for a, b in zip(graph.poses, before, strict=True)
    )
    print(
        f'bad: left out {sorted(graph.left_out)}, forced {index}; the others moved by '
        f'{MM * moved:.3f} mm at most; told: {joining.remarks[-1:]}'
    )


def coverage(arguments: argparse.Namespace) -> None:
    seed = arguments.seed + 80
    panels = skin(seed, 0.3)
    flat = [replace(panels[0], cylinder_radius=0.0)]
    along = Rotation.from_euler('z', np.pi / 2)
    height = _height(flat, along, seed)
    poses = [
        Pose(along, np.array([x, STEP * index, -DISTANCE]))
        for x in (0.0, height + 0.02)
        for index in range(3)
    ]
    mosaic = Mosaic(
        Unrolled(
            np.zeros(3),
            np.array([0, 1.0, 0]),
            np.array([1.0, 0, 0]),
            np.array([0, 0, -1.0]),
            np.inf,
        ),
        np.array([-0.6, -0.5]),
        np.array([0.8, 1.0]),
    )
    # Truth: places every 0.5 mm that are nearest to a grid point of a cloud that has a point.
    x, y = np.arange(-0.5, 1.0, 0.0005), np.arange(-0.6, 0.8, 0.0005)
    place = np.stack([*np.meshgrid(x, y), np.zeros((len(y), len(x)))], axis=-1).reshape(-1, 3)
    seen = np.zeros(len(place), bool)
    camera = read_rig(find('shipped:rig.yaml')).camera
    for number, (cloud, image) in enumerate(clouds(flat, poses, seed)):
        mosaic.add(number, cloud, poses[number], image, None)
        pixel = np.rint(camera.project(poses[number].inverse().apply(place)) / 2).astype(int)
        rows, columns = cloud.valid.shape
        inside = ((pixel >= 0) & (pixel < [columns, rows])).all(axis=1)
        seen[inside] |= cloud.valid[pixel[inside, 1], pixel[inside, 0]]
    side, fine = 0.01, 20
    measured = mosaic.measured()
    # The picture's axes: x along y, y along x.
    begin = np.rint((mosaic.low - [-0.6, -0.5]) / side).astype(int)
    seen = seen.reshape(len(y), len(x)).T
    share = seen.reshape(len(x) // fine, fine, len(y) // fine, fine).mean(axis=(1, 3))
    rows, columns = share.shape
    found = measured[-begin[1] :, -begin[0] :][:rows, :columns]
    true = share >= 0.5
    wrong = (found != true).sum() + measured.sum() - found.sum()
    gaps = [
        (np.round(MM * gap.size).astype(int).tolist(), round(gap.area, 4)) for gap in mosaic.gaps()
    ]
    print(
        f'coverage: {measured.sum()} cells of 10 mm, {true.sum()} in truth '
        f'({100 * (measured.sum() / true.sum() - 1):+.2f} %), {wrong} of them wrong '
        f'({100 * wrong / true.sum():.2f} %); gaps (mm, m2): {gaps[:3]}'
    )


def _height(panels: list[Panel], along: Rotation, seed: int) -> float:
    """Of what one cloud covers, across the flight, where it is least."""
    pose = Pose(along, np.array([0.0, 0.0, -DISTANCE]))
    ((cloud, _),) = clouds(panels, [pose], seed)
    place = pose.apply(cloud.points[cloud.valid].astype(float))
    low = [np.ptp(place[np.abs(place[:, 1] - y) < 0.005, 0]) for y in (-0.2, 0.0, 0.2)]
    return float(max(low))


def seen_from_the_middle(
    joining: Joining, poses: list[Pose], anchor: int | None = None
) -> tuple[NDArray, NDArray, NDArray]:
    """Errors (n, 6) seen from one pose, squared and normalised, and distances from it."""
    middle = len(poses) // 2 if anchor is None else anchor
    graph = joining.graph
    covariances = graph.covariances(anchor=middle)
    errors, normalised, distances = [], [], []
    start, true = graph.poses[middle], poses[middle]
    for index, (found, where) in enumerate(zip(graph.poses, poses, strict=True)):
        if index == middle:
            continue
        seen, there = start.inverse() @ found, true.inverse() @ where
        shift = start.rotation.apply(seen.translation - there.translation)
        turn = start.rotation.apply((seen.rotation * there.rotation.inv()).as_rotvec())
        errors.append(np.concatenate([shift, turn]))
        normalised.append(errors[-1] @ np.linalg.solve(covariances[index], errors[-1]) / 6)
        distances.append(np.linalg.norm(there.translation))
    return np.array(errors), np.array(normalised), np.array(distances)


ROWS = {
    'pairs': pairs,
    'strip': strip,
    'passes': passes,
    'flying': flying,
    'bare': bare,
    'bad': bad,
    'coverage': coverage,
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--only', nargs='+', choices=tuple(ROWS), default=tuple(ROWS))
    parser.add_argument('--seed', type=int, default=300)
    parser.add_argument('--skins', type=int, default=3)
    parser.add_argument('--clouds', type=int, default=40, help='of the strip')
    parser.add_argument('--length', type=float, default=6.0, help='of the passes, metres')
    arguments = parser.parse_args()
    for name in arguments.only:
        ROWS[name](arguments)


if __name__ == '__main__':
    main()
