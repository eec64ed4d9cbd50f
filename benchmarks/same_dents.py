"""Whether the inspection finds what another version of it found, on clouds of many kinds of skin.

python benchmarks/same_dents.py --write before.json --clouds out/clouds    # in the one version
python benchmarks/same_dents.py --against before.json --clouds out/clouds  # in the other

The clouds, of one photograph of each kind of `kind_scenes` at stride 2, without denser ones, and
two synthetic ones with hail, are made if the folder has none. Deviations are differences over the
stated standard uncertainty.
"""

from __future__ import annotations

import argparse
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
from inspection_speed import hailed
from kind_scenes import KINDS
from tqdm import tqdm

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.dents.dent import Estimate, MeasuredDent
from ftp_dent_ros.errors import RefusedFrameError
from ftp_dent_ros.inspection.measuring.inspection import inspect
from ftp_dent_ros.profilometry import Reconstructor, Settings

_SEED = 20
_ARRAYS = 'points', 'intensity', 'sigma', 'resolution'


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--clouds', type=Path, required=True, metavar='DIR')
    task = parser.add_mutually_exclusive_group(required=True)
    task.add_argument('--write', type=Path, metavar='FILE')
    task.add_argument('--against', type=Path, metavar='FILE')
    arguments = parser.parse_args()
    make_clouds(arguments.clouds)
    found = {
        path.stem: [record(dent) for dent in dents_in(path)]
        for path in tqdm(sorted(arguments.clouds.glob('*.npz')), 'inspecting')
    }
    if arguments.write:
        arguments.write.write_text(json.dumps(found))
        print(f'{sum(map(len, found.values()))} found in {len(found)} clouds')
        return
    before = json.loads(arguments.against.read_text())
    # As the file has them: what is not a number is told by its name.
    found = json.loads(json.dumps(found))
    worst, unlike = 0.0, 0
    for name in sorted(before):
        same, deviation = compared(before[name], found.get(name, []))
        worst = max(worst, deviation)
        if not same or deviation > 0:
            unlike += not same
            print(
                f'{name:22}{len(before[name]):4} before {len(found.get(name, [])):4} now'
                f'{"" if same else "  OTHERS"}   largest difference {deviation:.2g} u'
            )
    print(f'{unlike} of {len(before)} clouds with others; largest difference {worst:.2g} u')
    raise SystemExit(unlike > 0)


def make_clouds(folder: Path) -> None:
    """A file of arrays each kind, where the folder has none."""
    folder.mkdir(parents=True, exist_ok=True)
    if any(folder.glob('*.npz')):
        return
    for name, kind in tqdm(KINDS.items(), 'photographing'):
        scene = kind(np.random.default_rng([_SEED, len(name)]))
        method = Reconstructor(scene.rig, scene.pattern, Settings(stride=2))
        try:
            cloud = method.reconstruct(scene.photograph(_SEED))
        except RefusedFrameError:
            continue
        save(folder / f'{name}.npz', cloud)
    save(folder / 'synthetic_hail.npz', hailed())


def save(path: Path, cloud: Cloud) -> None:
    np.savez(path, **{name: getattr(cloud, name) for name in _ARRAYS})


def dents_in(path: Path) -> tuple[MeasuredDent, ...]:
    with np.load(path) as arrays:
        found = inspect(Cloud(*(arrays[name] for name in _ARRAYS)))
    return (*found.dents, *found.others)


def record(dent: MeasuredDent) -> dict[str, Any]:
    """Its kind and reason, and each estimate's value and uncertainty."""
    estimates = {
        name: (value.value, value.uncertainty)
        for name, value in vars(dent).items()
        if isinstance(value, Estimate)
    }
    return {
        'kind': dent.kind,
        'reason': dent.reason,
        'position': dent.position.tolist(),
        'significance': dent.significance,
        **estimates,
    }


def compared(before: list[dict[str, Any]], now: list[dict[str, Any]]) -> tuple[bool, float]:
    """Whether the same is listed in the same order, and the largest difference in any number."""
    if [(d['kind'], d['reason']) for d in before] != [(d['kind'], d['reason']) for d in now]:
        return False, math.inf
    worst = 0.0
    for one, other in zip(before, now, strict=True):
        for name, value in one.items():
            if not isinstance(value, list) or name == 'position':
                continue
            for was, become in zip(value, other[name], strict=True):
                if math.isnan(was) != math.isnan(become):
                    return False, math.inf
                if was == was and was != become:
                    worst = max(worst, abs(was - become) / max(value[1], 1e-9))
    return True, worst


if __name__ == '__main__':
    main()
