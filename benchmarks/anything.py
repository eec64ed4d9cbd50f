"""Photographs of anything: a cloud of what is there, or a refusal with its reason.

python benchmarks/anything.py [--count 10000] [--scale 0.5] [--jobs 2] [--method default]

From what holds no fringes never a point, never a traceback. Of photographs that hold the true
fringes in their places, in part or under noise, the points that are wrong by more than a
millimetre are counted.
"""

from __future__ import annotations

import argparse
import multiprocessing
import sys
from collections import defaultdict
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
from attempts import attempt
from kind_figures import METHODS, reconstructor
from kind_scenes import KindScene, scene, skin
from numpy.typing import NDArray
from tqdm import tqdm

from ftp_dent_ros.evaluation.scenes import make_rig
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.profilometry import Reconstructor

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'test'))
from any_photographs import KINDS, NOTHING, TRUE, any_photograph


@dataclass
class Outcome:
    """What became of one photograph."""

    index: int
    kind: str
    holds: str
    points: int = 0
    wrong: int = 0
    refused: str = ''
    crashed: str = ''


@lru_cache(maxsize=1)
def bench(scale: float, method: str) -> tuple[KindScene, NDArray[np.uint8], Reconstructor]:
    """A rig of a smaller camera with fringes as wide as the larger one's, and its photograph."""
    cv2.setNumThreads(1)
    rig = make_rig(0.8, 0.24, (round(1280 * scale), round(720 * scale), 1700.0 * scale), 1890.0)
    pattern = Pattern(1280, 720, 10.0 / scale, 640.0)
    one = scene(skin(np.random.default_rng(5)), rig=rig, pattern=pattern)
    return one, one.photograph(), reconstructor(rig, pattern, method, 1)


def outcome(task: tuple[int, float, str]) -> Outcome:
    """Reconstruct the photograph of a number."""
    index, scale, method = task
    one, base, method_of_it = bench(scale, method)
    photograph = any_photograph(index, base)
    result = Outcome(index, photograph.kind, photograph.holds)
    cloud = attempt(lambda: method_of_it.measure(photograph.image).cloud, result)
    if cloud is None:
        return result
    result.points = int(cloud.valid.sum())
    if photograph.holds == TRUE:
        error = one.surface.distance(cloud.points[cloud.valid].astype(float))
        result.wrong = int((np.abs(error) > 1e-3).sum())
    return result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--count', type=int, default=10000)
    parser.add_argument('--first', type=int, default=0, help='number of the first photograph')
    parser.add_argument('--scale', type=float, default=0.5, help='of a camera of 1280x720')
    parser.add_argument('--method', default='default', choices=METHODS)
    parser.add_argument('--jobs', type=int, default=1)
    arguments = parser.parse_args()
    numbers = range(arguments.first, arguments.first + arguments.count)
    todo = [(index, arguments.scale, arguments.method) for index in numbers]
    with multiprocessing.get_context('spawn').Pool(arguments.jobs) as pool:
        results = list(tqdm(pool.imap_unordered(outcome, todo, 16), total=len(todo)))
    print(f'{"":30}{"refused":>9}{"clouds":>9}{"points":>9}{"wrong":>9}{"crashed":>9}')
    for kind, (holds, _) in KINDS.items():
        some = [r for r in results if r.kind == kind]
        clouds = [r for r in some if r.points]
        print(
            f'{kind:30}{sum(bool(r.refused) for r in some):>9}{len(clouds):>9}'
            f'{sum(r.points for r in clouds):>9}'
            f'{sum(r.wrong for r in some) if holds == TRUE else "":>9}'
            f'{sum(bool(r.crashed) for r in some):>9}'
        )
    made_up = [r for r in results if r.holds == NOTHING and r.points]
    crashes = defaultdict(list)
    for r in results:
        if r.crashed:
            crashes[r.crashed].append(r.index)
    for crash, indices in crashes.items():
        print(f'CRASH {crash}: {len(indices)}, first {indices[0]}')
    print(
        f'{len(results)} photographs: {len(made_up)} clouds of nothing '
        f'{[r.index for r in made_up[:10]]}, {sum(map(len, crashes.values()))} tracebacks'
    )
    sys.exit(bool(made_up or crashes))


if __name__ == '__main__':
    main()
