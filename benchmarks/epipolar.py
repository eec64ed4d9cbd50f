"""The rig checked by every cloud: false alarms, and how soon a rig that is off is told.

python benchmarks/epipolar.py [--seeds 2] [--kinds clean,dirt25] [--jobs 1] [--first 0]
                              [--sequences 10000]
python benchmarks/epipolar.py --information

Scenes of all kinds under coded fringes, five photographs a seed, each of a skin of its own. A line
a kind: clouds; standard deviation of shift and turn over the stated ones; the stated one of the
shift; alarms of the true rig; and of rigs off by 0.02 degrees of pitch, by 0.3 pixels of pitch, by
0.02 degrees of roll, and by 0.1 degrees of yaw, which no fringe shows.

At the end so many clouds of a true rig are drawn, with replacement, from those that were seen, in
sequences of five: half of them of one kind, as of a flight along one skin (a cloud that is drawn
twice is one that the drone hovers over), half of all kinds.

With ``--information`` no photograph is taken: of the shipped rig before a flat skin, a line a
parameter of the projector tells how far its change moves the cloud and leads the light off the
epipolar lines, and at the end the directions of the Fisher information, over all parameters, by
shift, turn and stretch known to 0.02 pixels each.
"""

from __future__ import annotations

import argparse
import math
import sys
import warnings
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import lru_cache

import numpy as np
from kind_scenes import KINDS
from tqdm import tqdm

from ftp_dent_ros.calibration.wall_check import turned
from ftp_dent_ros.errors import RefusedFrameError
from ftp_dent_ros.files import find
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.profilometry import Reconstructor, Settings
from ftp_dent_ros.profilometry.epipolar_check import EpipolarCheck
from ftp_dent_ros.profilometry.rig_alarm import LAST, ONE_IN, off, rig_alarm
from ftp_dent_ros.profilometry.triangulation import triangulate
from ftp_dent_ros.rig.rig import Rig, read_rig

# Turns of the projector about its x, y and z, by name; pixels of pitch are those of the lens.
_OFF = 'pitch 0.02', '0.3 px', 'roll 0.02', 'yaw 0.1'


@lru_cache(maxsize=4)
def rigs(true: Rig) -> dict[str, Rig]:
    """The rig, and what is told of it if it has been knocked."""
    focal = true.projector.camera_matrix[1, 1]
    angles = (
        (math.radians(0.02), 0.0, 0.0),
        (0.3 / focal, 0.0, 0.0),
        (0.0, 0.0, math.radians(0.02)),
        (0.0, math.radians(0.1), 0.0),
    )
    told = {name: turned(true, np.array(angle)) for name, angle in zip(_OFF, angles, strict=True)}
    return {'true': true, **told}


@lru_cache(maxsize=10)
def reconstructor(rig: Rig, pattern: Pattern) -> Reconstructor:
    """Of coarse clouds: the check does not know of them."""
    return Reconstructor(rig, pattern, Settings(stride=8))


def checks(kind: str, seed: int) -> tuple[dict[str, list[EpipolarCheck]], int, int]:
    """Checks of `LAST` skins of a kind by rig, and how many were refused and said nothing."""
    found: dict[str, list[EpipolarCheck]] = {}
    refused = silent = 0
    for place in range(LAST):
        number = LAST * seed + place
        one = KINDS[kind](np.random.default_rng([number, 1366]))
        one = replace(one, pattern=replace(one.pattern, code='contrast'))
        photograph = one.photograph(number)
        for name, rig in rigs(one.rig).items():
            try:
                measured = reconstructor(rig, one.pattern).measure(photograph)
            except RefusedFrameError:
                refused += name == 'true'
                continue
            check = measured.epipolar
            if check is None or not check.seen:
                silent += name == 'true'
                continue
            found.setdefault(name, []).append(check)
    return found, refused, silent


def alarms_of_drawn(kinds: list[list[EpipolarCheck]], clouds: int) -> tuple[int, int]:
    """Sequences of `LAST` clouds drawn from those of each kind, and how many alarms they give."""
    rng = np.random.default_rng(1366)
    kinds = [each for each in kinds if each]
    everything = [check for each in kinds for check in each]
    count = clouds // LAST
    alarms = 0
    for number in range(count):
        pool = kinds[rng.integers(len(kinds))] if number % 2 else everything
        drawn = [pool[place] for place in rng.integers(len(pool), size=LAST)]
        alarms += any(rig_alarm(drawn[: place + 1]) for place in range(LAST))
    return count, alarms


def _work(case: tuple[str, int]) -> tuple[str, dict[str, list[EpipolarCheck]], int, int]:
    return case[0], *checks(*case)


def _all(cases: list[tuple[str, int]], jobs: int) -> Iterator:
    if jobs == 1:
        yield from map(_work, cases)
        return
    with ProcessPoolExecutor(jobs) as pool:
        yield from pool.map(_work, cases)


# Of the projector, by name: what it changes by, and its unit. Changes are such as a knock makes.
_PARAMETERS = {
    'pitch': (math.radians(0.02), '0.02 degrees'),
    'yaw': (math.radians(0.02), '0.02 degrees'),
    'roll': (math.radians(0.02), '0.02 degrees'),
    'centre along x': (1e-4, '0.1 mm'),
    'centre along y': (1e-4, '0.1 mm'),
    'centre along z': (1e-4, '0.1 mm'),
    'focal length u': (1e-3, '0.1 %'),
    'focal length v': (1e-3, '0.1 %'),
    'middle u': (0.3, '0.3 px'),
    'middle v': (0.3, '0.3 px'),
}
# By one cloud of a clean skin; pixels.
_KNOWN_TO = 0.02


def changed(rig: Rig, name: str, by: float) -> Rig:
    """The rig with one parameter of the projector changed."""
    index = list(_PARAMETERS).index(name)
    if index < 3:
        return turned(rig, by * np.eye(3)[index])
    if index < 6:
        return replace(rig, translation=rig.translation - by * np.eye(3)[index - 3])
    matrix = rig.projector.camera_matrix.copy()
    if index < 8:
        matrix[index - 6, index - 6] *= 1 + by
    else:
        matrix[index - 8, 2] += by
    return replace(rig, projector=replace(rig.projector, camera_matrix=matrix))


def information() -> None:
    """Print what each parameter of the projector shows of itself in one cloud."""
    rig = read_rig(find('shipped:rig.yaml'))
    pixels = rig.camera.pixel_grid(16)
    rays = rig.camera.rays(pixels).astype(np.float32)
    points = 0.8 * rays.astype(float)
    u, v = np.moveaxis(rig.projector.project(rig.to_projector(points)), -1, 0)
    lit = (u > 0) & (u < rig.projector.width) & (v > 0) & (v < rig.projector.height)
    along, across = u[lit] - u[lit].mean(), v[lit] - v[lit].mean()
    terms = np.stack([np.ones_like(along), along / along.std(), across / across.std()], axis=1)
    print(f'{"":16}{"changed by":>14}{"cloud":>9}{"shift":>8}{"turn":>8}{"stretch":>8}{"rest":>8}')
    shown = []
    for name, (by, unit) in _PARAMETERS.items():
        depth, row = triangulate(changed(rig, name, by), rays, u.astype(np.float32))
        beside = (v - row)[lit]
        found, *_ = np.linalg.lstsq(terms, beside, rcond=None)
        rest = beside - terms @ found
        error = 1e3 * float(np.sqrt(np.mean(np.square(depth[lit] - points[lit][:, 2]))))
        shown.append(found)
        print(
            f'{name:16}{unit:>14}{error:6.2f} mm'
            + ''.join(f'{abs(each):8.3f}' for each in (*found, rest.std()))
        )
    jacobian = np.array(shown).T / _KNOWN_TO
    strength, directions = np.linalg.eigh(jacobian.T @ jacobian)
    print('Fisher information, root, and its direction in units of these changes:')
    for value, direction in zip(strength[::-1], directions.T[::-1], strict=True):
        parts = sorted(zip(-np.abs(direction), direction, _PARAMETERS, strict=True))[:3]
        told = ', '.join(f'{part:+.2f} {name}' for _, part, name in parts)
        print(f'{math.sqrt(max(value, 0)):8.2f}  {told}')


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--seeds', type=int, default=1)
    parser.add_argument('--first', type=int, default=0)
    parser.add_argument('--kinds', default=','.join(KINDS))
    parser.add_argument('--jobs', type=int, default=1)
    parser.add_argument('--sequences', type=int, default=10_000, help='clouds that are drawn')
    parser.add_argument('--information', action='store_true')
    arguments = parser.parse_args()
    if arguments.information:
        information()
        return
    warnings.simplefilter('ignore', RuntimeWarning)
    seeds = range(arguments.first, arguments.first + arguments.seeds)
    header = f'{"kind":16}{"clouds":>7}{"refused":>8}{"silent":>7}{"z shift":>8}{"z turn":>7}'
    print(header + f'{"px":>7}{"true":>6}' + ''.join(f'{name:>12}' for name in _OFF))
    normalised, alarms, clouds, told_against, runs = [], 0, 0, 0, 0
    seen: list[list[EpipolarCheck]] = []
    caught = dict.fromkeys(_OFF, 0)
    for kind in tqdm(arguments.kinds.split(','), leave=False):
        results = [result[1:] for result in _all([(kind, seed) for seed in seeds], arguments.jobs)]
        true = [check for found, *_ in results for check in found.get('true', [])]
        z = np.array(
            [(c.shift / c.shift_deviation, c.turn / c.turn_deviation) for c in true]
        ).reshape(-1, 2)
        false = sum(bool(rig_alarm(found.get('true', []))) for found, *_ in results)
        right = {
            name: sum(bool(rig_alarm(found.get(name, []))) for found, *_ in results)
            for name in _OFF
        }
        spread = np.sqrt(np.mean(np.square(z), axis=0)) if len(z) else (math.nan, math.nan)
        deviation = float(np.median([c.shift_deviation for c in true])) if true else math.nan
        tqdm.write(
            f'{kind:16}{len(true):7}{sum(r[1] for r in results):8}{sum(r[2] for r in results):7}'
            f'{spread[0]:8.2f}{spread[1]:7.2f}{deviation:7.3f}{false:6}'
            + ''.join(f'{right[name]:>8} / {len(results)}' for name in _OFF)
        )
        sys.stdout.flush()
        seen.append(true)
        normalised.append(z)
        alarms += false
        clouds += len(true)
        runs += len(results)
        told_against += sum(off([check]) for check in true)
        for name in _OFF:
            caught[name] += right[name]
    z = np.concatenate(normalised)
    print(
        f'{clouds} clouds of a true rig: {alarms} alarms, {told_against} clouds against it '
        f'(calculated for normal scatter and no tolerance: {clouds / ONE_IN:.4f}); normalised '
        f'shift {np.sqrt(np.mean(z[:, 0] ** 2)):.2f}, turn {np.sqrt(np.mean(z[:, 1] ** 2)):.2f}, '
        f'largest {np.abs(z).max():.1f}'
    )
    count, false = alarms_of_drawn(seen, arguments.sequences)
    print(f'{LAST * count} clouds drawn from these, in sequences of {LAST}: {false} alarms')
    print(
        f'told within {LAST} clouds: '
        + ', '.join(f'{name} {caught[name]} of {runs}' for name in _OFF)
    )


if __name__ == '__main__':
    main()
