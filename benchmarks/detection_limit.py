"""What detection makes of a cloud, beside what the cloud's own noise allows.

python benchmarks/detection_limit.py [--photographs 72] [--seed 90000] [--smallest-depth 0.05]
    [--narrow]

Photographs as `ftp-dent evaluate --pod` takes them, of other numbers. A filter matched to a dent
(its shape, over its footprint, weighted by 1 / sigma^2) tells its depth to `chance`, from the
cloud's sigma and the length over which that is correlated. A threshold of six of these finds 90 %
of what is 7.3 deep: "allowed" is that depth of a dent 30 mm wide, the median over places where
dents were, "reached" the depth found in 90 % of cases (a90). "Above" are the dents deeper than 7.3
and than the smallest depth, "found" those of them that were; where both agree, what is missed is
missed by the photograph. "Told" is the smallest depth that the inspection states it would have
found where they lie (`Inspection.findable`, medians), "deeper" are the dents deeper than that, and
"found" again those of them that were: what is told is true where most are. "Beside", "deeper" and
"found" are the same of the bare skin around them, where no dent adds to the cloud's own doubt.
"sd" is that of the depths' errors over their stated uncertainties. `--narrow`: twelve dents of one
to 1.4 smallest widths a photograph, in place of its four wider ones.
"""

from __future__ import annotations

import argparse
import math
from collections import defaultdict
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.dents.dent import SmallestDent
from ftp_dent_ros.errors import FtpDentError
from ftp_dent_ros.evaluation.detection import detection, reconstructor_at, scene_of
from ftp_dent_ros.evaluation.scenes import Scene
from ftp_dent_ros.inspection.measuring.inspection import inspect
from ftp_dent_ros.inspection.measuring.places.detection import SIGNIFICANT
from ftp_dent_ros.inspection.measuring.places.evidence import chance
from ftp_dent_ros.inspection.measuring.skin.noise import Noise, reach_of
from ftp_dent_ros.simulation import Dent
from ftp_dent_ros.simulation.dents import SMOOTH, Cap, Gaussian, RaisedCosine, Shape
from ftp_dent_ros.simulation.truth import TrueDent, match_truth, true_dents

WIDTH = 0.03
# Of narrow dents: smallest and largest width, depths, and by what part of the distance they are
# apart; metres. The ratio of length and width is drawn from 1 to `_LONGEST`.
_WIDTHS, _DEPTHS, _APART, _LONGEST = (0.01, 0.014), (5e-5, 1e-3), (0.085, 0.07), 1.5
_SHAPES: tuple[Shape, ...] = SMOOTH, RaisedCosine(), Gaussian(), Cap()
# Skin around a dent, from and to how many of its lengths off its middle.
_BESIDE = 0.7, 1.4
# Of a normal distribution, 90 %.
_MOST = 1.2816
_NOTHING = np.full(2, 1e-9)

# Depth, width, whether it was found, its normalised error, depth over chance, chance at `WIDTH`,
# the smallest depths that the inspection says it would have found there and beside it.
Row = tuple[float, float, float, float, float, float, float, float]


def allowed(cloud: Cloud, dent: TrueDent) -> tuple[float, float]:
    """Standard deviation of the matched filter at a dent, and for one `WIDTH` wide, metres."""
    off = np.linalg.norm(np.nan_to_num(cloud.points, nan=1e3) - dent.position, axis=-1)
    size = math.sqrt(dent.length * dent.width)
    sigma: NDArray = cloud.sigma[off < size / 4]
    sigma = sigma[np.isfinite(sigma)]
    if not len(sigma):
        return math.inf, math.inf
    alike = float(np.mean(sigma.astype(float) ** -2) ** -0.5)
    noise = Noise(_NOTHING, np.array([0.0, 0.1]), sigma, reach_of(cloud.resolution))
    return chance(noise, size, alike), chance(noise, WIDTH, alike)


def told_at(
    cloud: Cloud, findable: NDArray[np.float32], dent: TrueDent, least: float, most: float
) -> float:
    """The smallest depth that would have been found, as the inspection tells, metres.

    The median of the places between `least` and `most` metres off its middle.
    """
    off = np.linalg.norm(np.nan_to_num(cloud.points, nan=1e3) - dent.position, axis=-1)
    at = findable[(off >= least) & (off < most) & np.isfinite(findable)]
    return float(np.median(at)) if len(at) else math.inf


def narrowed(scene: Scene, index: int, distance: float) -> Scene:
    """The same skin with narrow dents alone."""
    rng = np.random.default_rng([2027, index])
    dents = []
    for x in (-1.5, -0.5, 0.5, 1.5):
        for y in (-1, 0, 1):
            width = rng.uniform(*_WIDTHS)
            depth = min(math.exp(rng.uniform(*np.log(_DEPTHS))), width / 12)
            shape = _SHAPES[int(rng.integers(len(_SHAPES)))]
            part, _ = Dent(0, 0, 1, 1, 1, 0, shape).size_at()
            place = distance * np.array([x, y]) * _APART + rng.uniform(-0.004, 0.004, 2)
            size = width * rng.uniform(1, _LONGEST) / part, width / part
            angle = float(rng.uniform(0, math.pi))
            dents.append(Dent(float(place[0]), float(place[1]), *size, depth, angle, shape))
    return replace(scene, panels=(replace(scene.panel, dents=tuple(dents)),))


def rows_of(
    index: int, least: float, narrow: bool
) -> tuple[tuple[float, str, str], list[Row], int]:
    """Distance, skin and light of a photograph, its dents, and how many are false."""
    distance, skin, light, scene = scene_of(index)
    scene = narrowed(scene, index, distance) if narrow else scene
    truth = true_dents(scene.surface)
    kind = distance, skin, light
    try:
        cloud = reconstructor_at(distance).measure(scene.photograph(index), True).cloud
        seen = inspect(cloud, SmallestDent(smallest_depth=least))
    except FtpDentError:
        gone = math.nan, 0.0, math.nan, math.inf, math.inf
        return kind, [(t.depth, t.width, 0.0, *gone) for t in truth], 0
    pairs = match_truth(
        [dent.position for dent in seen.dents],
        [true.position for true in truth],
        [true.width / 2 for true in truth],
    )
    rows = []
    for number, true in enumerate(truth):
        hit = number in pairs
        error = math.nan
        if hit:
            best = seen.dents[pairs[number]]
            error = (best.depth.value - true.depth) / best.depth.uncertainty
        own, usual = allowed(cloud, true)
        told = (
            told_at(cloud, seen.findable, true, 0.0, true.width / 2),
            told_at(cloud, seen.findable, true, *(part * true.length for part in _BESIDE)),
        )
        rows.append((true.depth, true.width, float(hit), error, true.depth / own, usual, *told))
    return kind, rows, len(seen.dents) - len(pairs)


def line(rows: list[Row], least: float) -> str:
    """A line of the table."""
    depth, width, hit, error, ratio, usual, told, beside = np.array(rows, float).T
    sure = SIGNIFICANT + _MOST
    able = (ratio > sure) & (depth > 1.2 * least)
    known = error[np.isfinite(error)]
    reached = 1e3 * detection(depth, width, hit).a90
    cells = (
        f'{len(rows)}',
        f'{sure * 1e3 * np.nanmedian(usual):.3f}',
        f'{reached:.3f}' if math.isfinite(reached) else 'none',
        f'{able.sum()}',
        f'{int(hit[able].sum())}',
        f'{1e3 * np.median(told):.3f}',
        f'{(depth > told).sum()}',
        f'{int(hit[depth > told].sum())}',
        f'{1e3 * np.median(beside):.3f}',
        f'{(depth > beside).sum()}',
        f'{int(hit[depth > beside].sum())}',
        f'{known.std():.2f}' if len(known) > 2 else '',
    )
    return ''.join(f'{cell:>9}' for cell in cells)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--photographs', type=int, default=72)
    parser.add_argument('--seed', type=int, default=90000, help='number of the first')
    parser.add_argument('--smallest-depth', type=float, default=0.05, help='mm')
    parser.add_argument('--narrow', action='store_true', help='dents about the smallest width')
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    least = arguments.smallest_depth / 1e3
    table: dict[tuple, list[Row]] = defaultdict(list)
    false = 0
    for step in tqdm(range(arguments.photographs), unit='photograph'):
        kind, rows, more = rows_of(arguments.seed + step, least, arguments.narrow)
        table[kind] += rows
        table[(*kind[:2], 'all lights')] += rows
        false += more
    told = 'told', 'deeper', 'found', 'beside', 'deeper', 'found'
    head = 'n', 'allowed', 'reached', 'above', 'found', *told, 'sd'
    print(f'{"depths in mm":26}' + ''.join(f'{name:>9}' for name in head))
    for (distance, skin, light), rows in sorted(table.items()):
        print(f'{f"{distance} m, {skin}, {light}":26}{line(rows, least)}')
    print(f'dents where none is: {false}')


if __name__ == '__main__':
    main()
