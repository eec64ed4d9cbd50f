"""Pairs of dents in one, and single dents: which have a word that they may be several.

python benchmarks/overlapping_dents.py [--count 76] [--seed 2]

Clouds without a photograph: the true surface 0.7 m away at points 1.4 mm apart, with noise of 2 um
that is correlated as by fringe windows. Pairs and single dents are those of `dent_shapes.py`,
singles from 0.2 mm deep on.
"""

from __future__ import annotations

import argparse
from collections import Counter

import cv2
import numpy as np
from dent_shapes import FAMILIES
from tqdm import tqdm

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.inspection.measuring.inspection import inspect
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.simulation import Dent, Panel, Surface

_NOISE, _DISTANCE, _PIXEL = 2e-6, 0.7, 1 / 500
_SHAPE = 150, 200
_SINGLES = 'eq. 18', 'cosine', 'gaussian', 'cap', 'flat', 'crater', 'oil can'
_SHALLOWEST = 2e-4


def cloud_of(dents: tuple[Dent, ...], rng: np.random.Generator) -> Cloud:
    """A flat skin with dents in the middle, without a photograph."""
    v, u = np.indices(_SHAPE)
    x, y = (u - _SHAPE[1] / 2) * _PIXEL, (v - _SHAPE[0] / 2) * _PIXEL
    rays = np.stack([x, y, np.ones_like(x)], axis=-1)
    skin = Panel(Pose.from_rpy((0, 0, 0), (0, 0, _DISTANCE)), (-1, 1, -1, 1), dents=dents)
    white = cv2.GaussianBlur(rng.normal(size=_SHAPE), (0, 0), 1.5)
    depth = Surface((skin,)).intersect(rays) + _NOISE * white / white.std()
    points = (rays * depth[..., None]).astype(np.float32)
    return Cloud(points, np.full(_SHAPE, 80, np.float32))


def listed(dents: tuple[Dent, ...], rng: np.random.Generator) -> str:
    """What is made of dents."""
    inspection = inspect(cloud_of(dents, rng))
    found = [*inspection.dents, *inspection.others]
    if len(found) != 1:
        return 'not listed' if not found else 'several'
    reason = found[0].reason
    if 'several' in reason:
        return 'one that may be several'
    return 'one with another word' if reason else 'one without a word'


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--count', type=int, default=76, help='pairs, and as many singles')
    parser.add_argument('--seed', type=int, default=2)
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    rng = np.random.default_rng(arguments.seed)
    table: dict[str, Counter[str]] = {'pairs': Counter(), 'singles': Counter()}
    for _ in tqdm(range(arguments.count), unit='pair'):
        table['pairs'][listed(FAMILIES['double'](rng), rng)] += 1
        single = FAMILIES[str(rng.choice(_SINGLES))](rng)
        if single[0].depth >= _SHALLOWEST:
            table['singles'][listed(single, rng)] += 1
    for name, counts in table.items():
        print(f'{name}: {", ".join(f"{n} {what}" for what, n in sorted(counts.items()))}')


if __name__ == '__main__':
    main()
