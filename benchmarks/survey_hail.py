"""Hail on 2 square metres, from photographs through `ftp-dent survey`: is each dent counted once?

python benchmarks/survey_hail.py FOLDER [--seed 600] [--dents 120] [--least-depth 0.1] [--drops 3]

A fuselage of 3 m radius, 2 m along it by 1 m round it, in 40 photographs: five passes to and fro
that overlap by half, under an autopilot that errs by 3 cm and 0.9 degrees. Dents are 8 to 25 mm
wide (contour of 10 %), as near as 30 mm to each other, and 0.1 to 0.6 mm deep. Depths and widths
that the software is not asked for (--smallest-width) are told apart. Errors over what is stated
are those of whole dents. Seed 600 chose how clouds are averaged; 5001 and later nothing.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from flight_bags import EVERY_NS, START_NS, Taken, record
from glass_drops import drops
from kind_scenes import by_contour
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from survey import DISTANCE, MM, erring
from tqdm import tqdm

from ftp_dent_ros.cli.main import main as command
from ftp_dent_ros.files import find
from ftp_dent_ros.pattern.file import read_pattern
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.rig.rig import read_rig
from ftp_dent_ros.simulation import Dent, Paint, Panel, Photometry, Renderer, Rivet, Surface
from ftp_dent_ros.simulation.dents import Gaussian
from ftp_dent_ros.simulation.paint import Dirt, Lettering, scratches

RADIUS, SKIN, APART = 3.0, (1.0, 2.0), 0.03
ROWS, COLUMNS, ROW = 5, 8, 0.18
# A listed dent is a true one if it lies this near, metres.
NEAR = 6e-3


def hailed(rng: np.random.Generator, count: int, least_depth: float) -> tuple[Dent, ...]:
    """Dents as hail leaves them, none nearer to another than `APART`."""
    dents: list[Dent] = []
    half, length = SKIN[0] / 2 - 0.03, SKIN[1] - 0.03
    while len(dents) < count:
        place = rng.uniform((-half, 0.03), (half, length))
        if all(np.hypot(place[0] - d.x, place[1] - d.y) > APART for d in dents):
            width = rng.uniform(0.008, 0.025)
            depth = np.exp(rng.uniform(np.log(least_depth), np.log(6e-4)))
            long = width * rng.uniform(1, 1.2)
            dents.append(by_contour(*place, long, width, depth, rng.uniform(0, 3), Gaussian()))
    return tuple(dents)


def panel(seed: int, dents: tuple[Dent, ...]) -> Panel:
    """The fuselage: rivets every 0.25 m, scratches, letters and dirt."""
    rng = np.random.default_rng([seed, 1])
    extent = (-0.8, 0.8, -0.5, 2.5)
    marks = [*scratches(40, (-0.5, 0.5, 0.0, 2.0), seed), Dirt(0.06, seed=seed)]
    marks += [
        Lettering(*rng.uniform((-0.4, 0.1), (0.4, 1.9)), 'NO STEP', 0.02, (0.4,) * 3)
        for _ in range(5)
    ]
    rivets = [
        Rivet(float(x), float(y))
        for x in (-0.5, -0.25, 0.0, 0.25, 0.5)
        for y in np.arange(-0.5, 2.5, 0.025)
        if all(np.hypot(x - d.x, y - d.y) > 0.02 for d in dents)
    ]
    paint = Paint(albedo=0.6, roughness=0.3, marks=tuple(marks))
    frame = Pose(Rotation.identity(), np.zeros(3))
    return Panel(frame, extent, RADIUS, paint, dents, tuple(rivets))


def on_skin(x: NDArray, y: NDArray, height: float = 0.0) -> tuple[NDArray, NDArray]:
    """Points above the skin and the angle about its axis, of places along it."""
    angle = np.asarray(x) / RADIUS
    out = RADIUS + height
    return np.stack([out * np.sin(angle), y, RADIUS - out * np.cos(angle)], axis=-1), angle


def way(seed: int) -> list[Pose]:
    """True poses of the camera, to and fro."""
    rng = np.random.default_rng([seed, 2])
    along = np.linspace(0.25, SKIN[1] - 0.25, COLUMNS)
    poses = []
    for row in range(ROWS):
        for y in along[:: -1 if row % 2 else 1]:
            place, angle = on_skin(ROW * (row - (ROWS - 1) / 2), y, DISTANCE)
            turn = Rotation.from_rotvec([0, -angle, 0]) * Rotation.from_euler('z', np.pi / 2)
            wobble = Rotation.from_rotvec(rng.normal(0, 0.008, 3))
            poses.append(Pose(turn * wobble, place + rng.normal(0, 0.006, 3)))
    return poses


def photographed(skin: Panel, poses: list[Pose], seed: int, count: int = 0) -> Iterator[Taken]:
    """Photographs through so many drops on the camera's glass."""
    rig, pattern = read_rig(find('shipped:rig.yaml')), read_pattern(find('shipped:pattern.yaml'))
    renderer = Renderer(rig, pattern.draw(), Photometry(reference_distance=DISTANCE))
    stated = erring(poses, seed)
    columns, rows, _ = drops((rig.camera.height, rig.camera.width), count, seed + 101)
    for index, (pose, said) in enumerate(zip(tqdm(poses, 'photographs'), stated, strict=True)):
        seen = Surface((skin,)).transformed(pose.inverse())
        image = renderer.render(seen, np.random.default_rng([seed, index]))
        if count:
            image = cv2.remap(image, columns, rows, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
        yield START_NS + EVERY_NS * (index + 1), image, said


def judge(listed: list[dict], dents: tuple[Dent, ...], poses: list[Pose], found: list[Pose]):
    """The list against what there is; the survey's map is laid on the world by its cameras."""
    if not dents:
        return np.zeros(len(listed), int), np.full(len(listed), np.inf)
    true, _ = on_skin(np.array([d.x for d in dents]), np.array([d.y for d in dents]))
    there = np.array([p.translation + p.rotation.apply([0, 0, DISTANCE]) for p in poses])
    here = np.array([p.translation + p.rotation.apply([0, 0, DISTANCE]) for p in found])
    turn, _ = Rotation.align_vectors(there - there.mean(axis=0), here - here.mean(axis=0))
    places = np.array([each['position'] for each in listed]).reshape(-1, 3) - here.mean(axis=0)
    places = turn.apply(places) + there.mean(axis=0)
    apart = np.linalg.norm(places[:, None] - true, axis=-1)
    return apart.argmin(axis=1), apart.min(axis=1)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('folder', type=Path)
    parser.add_argument('--seed', type=int, default=600)
    parser.add_argument('--dents', type=int, default=120)
    parser.add_argument('--least-depth', type=float, default=0.1, help='millimetres')
    parser.add_argument('--drops', type=int, default=0, help="on the camera's glass")
    parser.add_argument('--smallest-width', type=float, default=7.0, help='asked for, millimetres')
    parser.add_argument('--smallest-depth', type=float, default=0.06, help='the same')
    arguments = parser.parse_args()
    folder, seed = arguments.folder, arguments.seed
    dents = hailed(np.random.default_rng(seed), arguments.dents, arguments.least_depth / MM)
    poses = way(seed)
    named = f'hail_{seed}_{arguments.dents}' + f'_{arguments.drops}' * bool(arguments.drops)
    bag, out = folder / named, folder / f'survey_{seed}'
    if not bag.exists():
        rig = read_rig(find('shipped:rig.yaml'))
        pattern = read_pattern(find('shipped:pattern.yaml'))
        taken = photographed(panel(seed, dents), poses, seed, arguments.drops)
        record(bag, taken, rig, pattern)
    words = ['survey', str(bag), '--output', str(out)]
    words += ['--smallest-width', str(arguments.smallest_width)]
    words += ['--smallest-depth', str(arguments.smallest_depth)]
    if command(words):
        sys.exit(2)
    told = json.loads((out / 'survey.json').read_text(encoding='utf-8'))
    found = [
        Pose(Rotation.from_quat(each['quaternion']), np.array(each['position']))
        for each in told['poses']
    ]
    listed = [each for each in told['dents'] if each['kind'] == 'dent']
    owner, off = judge(listed, dents, poses, found)
    is_true = off < NEAR
    counts = np.bincount(owner[is_true], minlength=max(len(dents), 1))
    for each, whose, away in zip(listed, owner, off, strict=True):
        if away >= NEAR or counts[whose] > 1:
            what = 'no dent' if away >= NEAR else 'listed twice'
            print(
                f'  {what}: number {each["number"]}, depth {each["depth_mm"]:.3f} mm, width '
                f'{each["width_mm"] or 0:.1f} mm, cut {each["cut"]}, {each["sightings"]} '
                f'sightings, {MM * away:.1f} mm off'
            )
    for index in np.flatnonzero(counts[: len(dents)] == 0):
        dent = dents[index]
        _, width = dent.size_at(0.1)
        print(f'  missed: depth {MM * dent.depth:.3f} mm, width {MM * width:.1f} mm')
    missed, farthest = (counts[: len(dents)] == 0).sum(), MM * off[is_true].max(initial=0)
    print(
        f'{len(dents)} dents, {len(listed)} listed; {(counts == 1).sum()} once, '
        f'{(counts > 1).sum()} twice, {missed} not, {(~is_true).sum()} false; '
        f'{len(told["dents"]) - len(listed)} others; places off by {farthest:.2f} mm at most'
    )
    _tell_errors([(each, dents[whose]) for each, whose in pairs(listed, owner, is_true, counts)])


def pairs(listed: list[dict], owner: NDArray, is_true: NDArray, counts: NDArray):
    """Dents that are listed once and whole, each with the index of the true one."""
    for each, whose, near in zip(listed, owner, is_true, strict=True):
        if near and counts[whose] == 1 and not each['cut']:
            yield each, whose


def _tell_errors(found: list[tuple[dict, Dent]]) -> None:
    """Errors of depth, length and width by the dents' widths."""
    for low, high in ((8, 11), (11, 14), (14, 18), (18, 26), (8, 26)):
        rows, parts = [], []
        for each, dent in found:
            length, width = dent.size_at(0.1)
            true = {'depth': MM * dent.depth, 'length': MM * length, 'width': MM * width}
            if low <= true['width'] < high:
                off = [
                    (each[f'{name}_mm'] - value) / each[f'{name}_uncertainty_mm']
                    for name, value in true.items()
                ]
                rows.append(off)
                parts.append(each['depth_mm'] / true['depth'] - 1)
        if rows:
            z = np.sqrt(np.square(rows).mean(axis=0))
            print(
                f'  {low} to {high} mm wide: {len(rows)}, depths off by '
                f'{100 * np.median(parts):.0f} % (median), errors over stated of depth, length, '
                f'width {z[0]:.2f}, {z[1]:.2f}, {z[2]:.2f}'
            )


if __name__ == '__main__':
    main()
