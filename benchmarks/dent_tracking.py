"""Dents of many clouds as one list, under an erring autopilot: counted once each, or not.

python benchmarks/dent_tracking.py [--flights 20] [--dents 120] [--error 0.025] [--yaw 0.6]
                                   [--alike]

A camera goes to and fro over 2 square metres of hail in 40 clouds; each dent is found in 95 % of
the clouds that show it. Poses are off by a wander (root mean square along x and y in metres, and
about z in degrees) that forgets itself over eight clouds; what they state is as large. Sizes and
places within a cloud are as uncertain as those measured from photographs.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation
from tqdm import tqdm

from ftp_dent_ros.dents.dent_list import DentList
from ftp_dent_ros.pose import Pose

sys.path.append(str(Path(__file__).resolve().parents[1] / 'test'))
from dent_samples import make_dent

SKIN = 2.0, 1.0
VIEW = 0.5, 0.3
CLOUDS, ROWS = 40, 5
FOUND = 0.95
# Within a cloud: of centres, metres, and of depths and widths, parts.
PLACE, DEPTH, SIZE = 2e-4, 0.01, 0.015
APART = 0.02


@dataclass(frozen=True)
class Outcome:
    """Of one flight."""

    true: int
    listed: int
    merged: int
    twice: int
    largest: float  # pose error, metres
    seconds: float  # processor time a cloud


def flight(seed: int, dents: int, error: float, yaw: float, alike: bool) -> Outcome:
    """Fly, and hold the list against what was there."""
    rng = np.random.default_rng(seed)
    places = _places(rng, dents)
    depth, width = rng.uniform(1.5e-4, 6e-4, dents), rng.uniform(0.01, 0.025, dents)
    length = width * rng.uniform(1, 1.3, dents)
    if alike:
        depth, width = rng.uniform(3e-4, 3.3e-4, dents), rng.uniform(0.018, 0.02, dents)
        length = 1.1 * width
    listed = DentList()
    covariance = np.diag([error**2] * 3 + [math.radians(yaw) ** 2] * 3)
    shift, turn = rng.normal(0, error, 3), rng.normal(0, math.radians(yaw), 3)
    keep = math.exp(-1 / 8)
    owners: dict[tuple[int, float], int] = {}
    seen, largest, spent = set(), 0.0, 0.0
    for frame, (x, y) in enumerate(_way()):
        fresh = math.sqrt(1 - keep**2)
        shift = keep * shift + fresh * rng.normal(0, error, 3)
        turn = keep * turn + fresh * rng.normal(0, math.radians(yaw), 3) * [0.5, 0.5, 1]
        largest = max(largest, float(np.linalg.norm(shift[:2])))
        at = np.array([x, y, 0.8])
        rotation = Rotation.from_rotvec(turn)
        shown = []
        for index in range(dents):
            off = np.abs(places[index] - at[:2])
            if (off > np.array(VIEW) / 2 - 0.01).any() or rng.random() > FOUND:
                continue
            place = np.array([*places[index], 0.0]) + rng.normal(0, PLACE, 3)
            dent = make_dent(
                at + shift + rotation.apply(place - at),
                depth[index] * (1 + rng.normal(0, DEPTH)),
                length[index] * (1 + rng.normal(0, SIZE)),
                width[index] * (1 + rng.normal(0, SIZE)),
                normal=(0.0, 0.0, 1.0),
                sigma=4e-6,
            )
            owners[frame, dent.depth.value] = index
            shown.append(dent)
            seen.add(index)
        started = time.process_time()
        listed.add(frame, shown, Pose(Rotation.identity(), at + shift), covariance)
        spent += time.process_time() - started
    entries = listed.entries
    members = [{owners[s.frame, s.dent.depth.value] for s in entry.sightings} for entry in entries]
    several = [sum(index in each for each in members) for index in seen]
    return Outcome(
        len(seen),
        len(entries),
        sum(len(each) > 1 for each in members),
        sum(count > 1 for count in several),
        largest,
        spent / CLOUDS,
    )


def _places(rng: np.random.Generator, count: int) -> np.ndarray:
    places: list[np.ndarray] = []
    while len(places) < count:
        place = rng.uniform((0, 0), SKIN)
        if all(np.linalg.norm(place - other) > APART for other in places):
            places.append(place)
    return np.array(places)


def _way():
    along = np.linspace(VIEW[0] / 2, SKIN[0] - VIEW[0] / 2, CLOUDS // ROWS)
    for row, y in enumerate(np.linspace(VIEW[1] / 2, SKIN[1] - VIEW[1] / 2, ROWS)):
        for x in along if row % 2 == 0 else along[::-1]:
            yield x, y


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--flights', type=int, default=20)
    parser.add_argument('--dents', type=int, default=120)
    parser.add_argument('--error', type=float, default=0.025, help='metres, root mean square')
    parser.add_argument('--yaw', type=float, default=0.6, help='degrees, root mean square')
    parser.add_argument(
        '--alike', action='store_true', help='all dents within 10 % of one size, as no hail is'
    )
    parser.add_argument('--seed', type=int, default=100)
    arguments = parser.parse_args()
    outcomes = [
        flight(
            arguments.seed + k, arguments.dents, arguments.error, arguments.yaw, arguments.alike
        )
        for k in tqdm(range(arguments.flights), unit='flight')
    ]
    exact = sum(o.true == o.listed and not o.merged and not o.twice for o in outcomes)
    print(
        f'{len(outcomes)} flights over {arguments.dents} dents, poses off by up to '
        f'{100 * max(o.largest for o in outcomes):.0f} cm: counted exactly in {exact}; '
        f'true {sum(o.true for o in outcomes)}, listed {sum(o.listed for o in outcomes)}, '
        f'of several {sum(o.merged for o in outcomes)}, '
        f'listed twice {sum(o.twice for o in outcomes)}; '
        f'{1e3 * np.median([o.seconds for o in outcomes]):.0f} ms of processor time a cloud'
    )


if __name__ == '__main__':
    main()
