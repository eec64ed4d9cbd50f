"""What detection makes of a cloud, beside what the cloud's own noise allows.

python benchmarks/detection_limit.py [--photographs 72] [--seed 90000] [--smallest-depth 0.05]

Photographs as `ftp-dent evaluate --pod` takes them, of other numbers. A filter matched to a dent
(its shape, over its footprint, weighted by 1 / sigma^2) tells its depth to `chance`, from the
cloud's sigma and the length over which that is correlated. A threshold of six of these finds 90 %
of what is 7.3 deep: "allowed" is that depth of a dent 30 mm wide, the median over places where
dents were, "reached" the depth found in 90 % of cases (a90). "Above" are the dents deeper than 7.3
and than the smallest depth, "found" those of them that were; where both agree, what is missed is
missed by the photograph. "Told" is the smallest depth that the inspection states it would have
found where they lie (`Inspection.findable`, medians), "deeper" are the dents deeper than that, and
"found" again those of them that were: what is told is true where most are. "sd" is that of the
depths' errors over their stated uncertainties.
"""

from __future__ import annotations

import argparse
import math
from collections import defaultdict

import cv2
import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from ftp_dent_ros.cloud import Cloud
from ftp_dent_ros.errors import FtpDentError
from ftp_dent_ros.evaluation.detection.probability import detection
from ftp_dent_ros.evaluation.detection.trials import reconstructor_at, scene_of
from ftp_dent_ros.inspection.measuring.inspection import inspect
from ftp_dent_ros.inspection.measuring.places.detection import SIGNIFICANT
from ftp_dent_ros.inspection.measuring.places.evidence import chance
from ftp_dent_ros.inspection.measuring.skin.noise import Noise, reach_of
from ftp_dent_ros.inspection.settings import Settings
from ftp_dent_ros.simulation.truth import TrueDent, true_dents

WIDTH = 0.03
# Of a normal distribution, 90 %.
_MOST = 1.2816
_NOTHING = np.full(2, 1e-9)

# Depth, width, whether it was found, its normalised error, depth over chance, chance at `WIDTH`,
# the smallest depth that the inspection says it would have found.
Row = tuple[float, float, float, float, float, float, float]


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


def told_at(cloud: Cloud, findable: NDArray[np.float32], dent: TrueDent) -> float:
    """The smallest depth that would have been found at a dent, as the inspection tells, metres."""
    off = np.linalg.norm(np.nan_to_num(cloud.points, nan=1e3) - dent.position, axis=-1)
    at = findable[(off < dent.width / 2) & np.isfinite(findable)]
    return float(np.median(at)) if len(at) else math.inf


def rows_of(index: int, least: float) -> tuple[tuple[float, str, str], list[Row], int]:
    """Distance, skin and light of a photograph, its dents, and how many are false."""
    distance, skin, light, scene = scene_of(index)
    truth = true_dents(scene.surface)
    kind = distance, skin, light
    try:
        cloud = reconstructor_at(distance).measure(scene.photograph(index), True).cloud
        seen = inspect(cloud, Settings(smallest_depth=least))
    except FtpDentError:
        missed = [(t.depth, t.width, 0.0, math.nan, 0.0, math.nan, math.inf) for t in truth]
        return kind, missed, 0
    rows, left = [], list(seen.dents)
    for true in truth:
        near = [d for d in left if np.linalg.norm(d.position - true.position) < true.width / 2]
        best = min(near, key=lambda d: abs(d.depth.value - true.depth), default=None)
        left = [dent for dent in left if dent is not best]
        error = math.nan
        if best is not None:
            error = (best.depth.value - true.depth) / best.depth.uncertainty
        own, usual = allowed(cloud, true)
        found = float(best is not None)
        told = told_at(cloud, seen.findable, true)
        rows.append((true.depth, true.width, found, error, true.depth / own, usual, told))
    return kind, rows, len(left)


def line(rows: list[Row], least: float) -> str:
    """A line of the table."""
    depth, width, hit, error, ratio, usual, told = np.array(rows, float).T
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
        f'{known.std():.2f}' if len(known) > 2 else '',
    )
    return ''.join(f'{cell:>9}' for cell in cells)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--photographs', type=int, default=72)
    parser.add_argument('--seed', type=int, default=90000, help='number of the first')
    parser.add_argument('--smallest-depth', type=float, default=0.05, help='mm')
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    least = arguments.smallest_depth / 1e3
    table: dict[tuple, list[Row]] = defaultdict(list)
    false = 0
    for step in tqdm(range(arguments.photographs), unit='photograph'):
        kind, rows, more = rows_of(arguments.seed + step, least)
        table[kind] += rows
        table[(*kind[:2], 'all lights')] += rows
        false += more
    head = 'n', 'allowed', 'reached', 'above', 'found', 'told', 'deeper', 'found', 'sd'
    print(f'{"depths in mm":26}' + ''.join(f'{name:>9}' for name in head))
    for (distance, skin, light), rows in sorted(table.items()):
        print(f'{f"{distance} m, {skin}, {light}":26}{line(rows, least)}')
    print(f'dents where none is: {false}')


if __name__ == '__main__':
    main()
