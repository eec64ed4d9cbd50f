"""A long flight joined as the node `survey` joins it: memory and processor time.

python benchmarks/long_survey.py FOLDER [--clouds 3600] [--seed 400]
                                        [--sets 1] [--passes 3]

Three passes there and back along a skin that repeats itself every 1.8 m, so that 120 photographs
(reconstructed at stride 2 of 720p, and kept in FOLDER as clouds) show all of it. The autopilot
errs anew all along. Repeated photographs err alike each 1.8 m; with as many `--sets` of them as
periods, each flown and rendered anew, none is repeated. Memory is the largest of this process,
which renders nothing: another does.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from survey import (
    DISTANCE,
    HALF_S,
    MM,
    STATED,
    STEP,
    clouds,
    erring,
    flight,
    seen_from_the_middle,
    skin,
)
from tqdm import tqdm

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.files import written_aside
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.simulation import Panel
from ftp_dent_ros.simulation.paint import Dirt
from ftp_dent_ros.survey.footprint import Footprint, seen_skin
from ftp_dent_ros.survey.joining import Joining

# Clouds of a period; where the passes are, metres: a cloud is 0.34 m across.
PERIOD, PASSES = 40, (-0.24, 0.0, 0.24)
LENGTH = PERIOD * STEP


def repeated(panel: Panel) -> Panel:
    """A panel whose marks, rivets and dents along one period come again in the next."""

    def again(things):
        once = [each for each in things if not isinstance(each, Dirt) and 0 <= each.y < LENGTH]
        return tuple(replace(each, y=each.y + k * LENGTH) for each in once for k in (-1, 0, 1))

    paint = replace(panel.paint, marks=again(panel.paint.marks))
    return replace(panel, paint=paint, rivets=again(panel.rivets), dents=again(panel.dents))


def photograph(folder: Path, seed: int, sets: int, passes: int) -> None:
    """Clouds of one period of each pass, so many times anew, into files."""
    (panel,) = skin(seed, LENGTH, half=0.45)
    for number, x in enumerate(PASSES[:passes]):
        poses = [
            Pose(pose.rotation, pose.translation - [0, index // PERIOD * LENGTH, 0])
            for index, pose in enumerate(flight(seed + number, PERIOD * sets, x=x))
        ]
        seen = clouds([repeated(panel)], poses, seed + number)
        for index, (cloud, image) in enumerate(tqdm(seen, 'photographs', len(poses))):
            with written_aside(file_of(folder, number, index)) as aside, aside.open('wb') as out:
                layers = {'points': cloud.points, 'intensity': cloud.intensity}
                np.savez(out, **layers, sigma=cloud.sigma, skin=image)


def file_of(folder: Path, number: int, index: int) -> Path:
    return folder / f'{number}_{index}.npz'


def flown(
    seed: int, count: int, sets: int = 1, passes: int = len(PASSES)
) -> list[tuple[Pose, Path]]:
    """True poses of the whole flight, and the name of the file of each cloud."""
    each = -(-count // passes)
    result = []
    for number, x in enumerate(PASSES[:passes]):
        poses = flight(seed + number, PERIOD * sets, x=x)
        for place in range(each)[:: -1 if number % 2 else 1]:
            period, index = divmod(place, PERIOD * sets)
            along = np.array([0.0, period * sets * LENGTH, 0.0])
            pose = Pose(poses[index].rotation, poses[index].translation + along)
            result.append((pose, file_of(Path(), number, index)))
    return result[:count]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('folder', type=Path)
    parser.add_argument('--clouds', type=int, default=3600)
    parser.add_argument('--seed', type=int, default=400)
    parser.add_argument('--sets', type=int, default=1, help='of photographs, of a period each')
    parser.add_argument('--passes', type=int, default=len(PASSES))
    parser.add_argument('--only-photographs', action='store_true')
    arguments = parser.parse_args()
    folder, seed = arguments.folder, arguments.seed
    sets, passes = arguments.sets, arguments.passes
    if arguments.only_photographs:
        photograph(folder, seed, sets, passes)
        return
    if not file_of(folder, passes - 1, PERIOD * sets - 1).exists():
        words = [str(folder), '--seed', str(seed), '--only-photographs']
        words += ['--sets', str(sets), '--passes', str(passes)]
        subprocess.run([sys.executable, __file__, *words], check=True)
    way = flown(seed, arguments.clouds, sets, passes)
    stated = erring([pose for pose, _ in way], seed)
    joining, footprints, spent = Joining(), [], []
    for number, (_, name) in enumerate(tqdm(way, 'joining')):
        with np.load(folder / name) as kept:
            cloud = Cloud(kept['points'], kept['intensity'], kept['sigma'])
            image = kept['skin']
        started = time.process_time()
        joining.add(number * HALF_S, cloud, image, stated[number], STATED)
        joining.newest_covariance()
        footprints.append(Footprint.of(cloud))
        spent.append(time.process_time() - started)
    started = time.process_time()
    joining.finish()
    finished = time.process_time() - started
    memory = [resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024]
    graph = joining.graph
    started = time.process_time()
    drawn = seen_skin(footprints, graph.poses)
    drawing = time.process_time() - started
    memory.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
    found, true = (
        np.stack([pose.apply(np.array([0, 0, DISTANCE])) for pose in each])
        for each in (graph.poses, [pose for pose, _ in way])
    )
    first, second = np.random.default_rng(seed).integers(0, len(way), (2, 500_000))
    apart = np.linalg.norm(true[first] - true[second], axis=1)
    off = np.abs(np.linalg.norm(found[first] - found[second], axis=1) - apart)
    near = (apart > 0) & (apart < 1)
    _, normalised, _ = seen_from_the_middle(joining, [pose for pose, _ in way])
    area = 0.0 if drawn is None else drawn.area
    print(
        f'{len(way)} clouds, {len(graph.links)} pairs, {len(graph.left_out)} left out\n'
        f'memory {memory[0]:.0f} MB, {memory[1]:.0f} MB with the coverage ({area:.1f} m2) '
        f'drawn once, which takes {drawing:.1f} s\n'
        f'processor time a cloud {MM * np.median(spent):.0f} ms (median), '
        f'{MM * np.mean(spent):.0f} ms (mean), {MM * max(spent):.0f} ms at most, and '
        f'{finished:.1f} s at the end\n'
        f'distances below 1 m are off by {MM * off[near].max():.2f} mm at most, all up to '
        f'{apart.max():.0f} m by {MM * off.max():.0f} mm\n'
        f'poses seen from the middle one are off by {np.sqrt(normalised.mean()):.2f} times what '
        'is stated'
    )


if __name__ == '__main__':
    main()
