"""Strips without points through dents: one dent or several, and whether its intervals hold.

python benchmarks/cut_dents.py [--count 3] [--seed 731] [--json cut.json]

Photographs as `benchmarks/dent_shapes.py` takes them; from their clouds a strip is cut through
each dent in turn, from rim to rim, 3 to 12 mm wide and 0.15 to 0.5 of the dent's width, at any
angle and up to a quarter of the width beside its middle. What becomes of doubles is counted apart:
what parts two dents may be in the strip.
"""

from __future__ import annotations

import argparse
import json
import math
from collections import Counter
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from dent_shapes import SIZES, photograph, tasks
from kind_figures import reconstructor
from kind_scenes import PATTERN
from tqdm import tqdm

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.inspection.measuring.inspection import inspect
from ftp_dent_ros.simulation.truth import TrueDent, true_dents

# Metres; dents narrower than the least are not cut.
_LEAST, _STRIPS = 0.012, (0.003, 0.012)


def cut(cloud: Cloud, dent: TrueDent, rng: np.random.Generator) -> Cloud:
    """The cloud without a strip through a dent."""
    width = np.clip(rng.uniform(0.15, 0.5) * dent.width, *_STRIPS)
    angle, beside = rng.uniform(0, math.pi), rng.uniform(-0.25, 0.25) * dent.width
    across = np.cross(dent.normal, dent.axis)
    along = math.cos(angle) * dent.axis + math.sin(angle) * across
    points = cloud.points.copy()
    points[np.abs((points - dent.position) @ along - beside) < width / 2] = np.nan
    return replace(cloud, points=points)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--count', type=int, default=3, help='dents a family')
    parser.add_argument('--seed', type=int, default=731)
    parser.add_argument('--json', type=Path, help='where all errors go')
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    usual = {'only': '', 'without': 'gouge', 'dirt': 0.0, 'waviness': 0.0}
    todo = tasks(argparse.Namespace(**vars(arguments), **usual, stride=2, method='default'))
    rng = np.random.default_rng(arguments.seed)
    listed: Counter[str] = Counter()
    errors: list[dict] = []
    for task in tqdm(todo, unit='photograph'):
        one, placed = photograph(task)
        names = [name for name, dents in placed for _ in dents]
        cloud = (
            reconstructor(one.rig, PATTERN, 'default', 2).measure(one.photograph(task.seed)).cloud
        )
        for name, true in zip(names, true_dents(one.surface), strict=True):
            if true.width < _LEAST:
                continue
            seen = inspect(cut(cloud, true, rng))
            near = [
                m
                for m in (*seen.dents, *seen.others)
                if m.kind != 'step'
                and np.linalg.norm(m.position - true.position) < 0.6 * true.length
            ]
            count = 'none' if not near else 'one' if len(near) == 1 else 'several'
            listed[f'doubles: {count}' if name == 'double' else count] += 1
            if len(near) == 1 and name != 'double':
                told = [(getattr(near[0], size), getattr(true, size)) for size in SIZES]
                row = {
                    s: (m.value - t) / m.uncertainty for s, (m, t) in zip(SIZES, told, strict=True)
                }
                errors.append({'family': name, 'kind': near[0].kind, **row})
    print(f'listed as: {dict(listed)}; in doubt: {sum(e["kind"] == "other" for e in errors)}')
    for size in SIZES:
        ratio = np.array([e[size] for e in errors if e['kind'] != 'other'])
        held = 100 * np.mean(np.abs(ratio) < 1.96)
        print(f'{size:8}{len(ratio):4}  error / u {ratio.std():.2f}  held {held:.0f} %')
    if arguments.json:
        arguments.json.write_text(json.dumps(errors, indent=1))


if __name__ == '__main__':
    main()
