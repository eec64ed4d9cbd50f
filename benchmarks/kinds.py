"""Every kind of skin, light and sensor: coverage, errors over sigma, dents, false calls.

python benchmarks/kinds.py [--only dirt] [--seeds 2] [--code contrast] [--jobs 2] [--json out.json]
python benchmarks/kinds.py --unseen      # the hold-out: look at it last, choose nothing on it
python benchmarks/kinds.py --combined    # rigs and cameras of all sorts, kinds together
python benchmarks/kinds.py --dent-free --seeds 25 --method default    # false calls a square metre

A row a kind and method, over its seeds: the worst of them but for MAE and coverage, which are
means. Normalised errors are error / sigma: the root of their mean square, and the share below 4;
"edge" are the points within two fringes of an edge of depth, light, albedo, clipping or the rim.
"""

from __future__ import annotations

import argparse
import json
import math
import multiprocessing
import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from kind_figures import METHODS, Figures, figures
from kind_scenes import KINDS, Kind
from kind_verdict import verdict
from kinds_combined import COMBINED
from kinds_parts import PARTS
from kinds_rigs import RIGS
from kinds_unseen import UNSEEN
from tqdm import tqdm

from ftp_dent_ros.pattern.pattern import CODES

COLUMNS = 'cover', 'MAE', '>0.1', 'z', '<4', 'edge z', '<4', 'centre', 'found', 'sizes u', 'false'

GROUPS: dict[str, dict[str, Kind]] = {
    'usual': KINDS,
    'unseen': UNSEEN,
    'combined': RIGS | COMBINED | PARTS,
}

Task = tuple[str, str, bool, int, tuple[str, ...], int, str]


def one(task: Task) -> list[Figures]:
    """All methods on one photograph."""
    name, group, dent_free, seed, methods, stride, code = task
    cv2.setNumThreads(1)
    # A kind's name, not its place in a list, decides what is drawn.
    scene = GROUPS[group][name](np.random.default_rng([seed, *name.encode()]))
    scene = replace(scene, pattern=replace(scene.pattern, code=code))
    if dent_free:
        scene = replace(scene, panels=scene.bare.panels)
    truth = scene.truth(stride)
    return [figures(name, scene, truth, method, seed, stride) for method in methods]


def row(results: list[Figures]) -> list[str]:
    """A kind by one method, over its seeds."""
    measured = [r for r in results if not (r.refused or r.crashed)]
    if not measured:
        return [(results[0].crashed or results[0].refused)[:80]]
    dents = [dent for r in measured for dent in r.dents]
    worst = max(dents, key=lambda d: abs(np.nan_to_num(d.cloud_error)), default=None)
    sizes = [
        abs(error) / u
        for d in dents
        for error, u in (
            (d.depth_error, d.depth_u),
            (d.length_error, d.length_u),
            (d.width_error, d.width_u),
        )
        if u > 0 and math.isfinite(error)
    ]
    false = sum(len(r.false_dents) + len(r.false_bumps) for r in measured)

    def extreme(name: str, choose) -> float:
        values = [getattr(r, name) for r in measured if not math.isnan(getattr(r, name))]
        return choose(values) if values else math.nan

    return [
        f'{100 * np.mean([r.coverage for r in measured]):.1f}',
        f'{np.nanmean([r.mae for r in measured]):.4f}',
        f'{100 * extreme("wrong", max):.2f}%',
        f'{extreme("spread", max):.2f}',
        f'{100 * extreme("below4", min):.1f}',
        f'{extreme("edge_spread", max):.2f}',
        f'{100 * extreme("edge_below4", min):.1f}',
        f'{worst.cloud_error:+.3f}' if worst else '',
        f'{sum(d.found for d in dents)}/{len(dents)}' if dents else '',
        f'{max(sizes):.1f}' if sizes else '',
        str(false),
    ]


def tasks(arguments: argparse.Namespace) -> Iterator[Task]:
    """A photograph each."""
    methods = tuple(arguments.method or METHODS)
    for name in GROUPS[arguments.group]:
        if any(part in name for part in arguments.only.split(',')):
            for seed in range(arguments.first_seed, arguments.first_seed + arguments.seeds):
                free, stride = arguments.dent_free, arguments.stride
                yield name, arguments.group, free, seed, methods, stride, arguments.code


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--only', default='', help='parts of names of kinds, with commas between')
    parser.add_argument(
        '--unseen',
        action='store_const',
        const='unseen',
        dest='group',
        help='the kinds that are held out',
    )
    parser.add_argument(
        '--combined',
        action='store_const',
        const='combined',
        dest='group',
        help='rigs, cameras and combinations',
    )
    parser.add_argument('--dent-free', action='store_true', help='the same skins without dents')
    parser.add_argument('--seeds', type=int, default=1, help='photographs a kind')
    parser.add_argument('--first-seed', type=int, default=0)
    parser.add_argument('--method', action='append', choices=METHODS)
    parser.add_argument('--code', choices=CODES, default='stripe', help='of the pattern')
    parser.add_argument('--stride', type=int, default=2)
    parser.add_argument('--jobs', type=int, default=1, help='processes')
    parser.add_argument('--json', type=Path, help='where all figures go')
    parser.add_argument('--details', action='store_true', help='every dent, and what is false')
    parser.set_defaults(group='usual')
    arguments = parser.parse_args()
    todo = list(tasks(arguments))
    if not todo:
        parser.error(
            f'no kind has {arguments.only!r} in its name: give one of '
            + ', '.join(GROUPS[arguments.group])
        )
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
    results: list[Figures] = []
    with multiprocessing.get_context('spawn').Pool(arguments.jobs) as pool:
        for some in tqdm(pool.imap(one, todo), total=len(todo), unit='photograph'):
            results += some
    if arguments.json:
        text = json.dumps([r.as_dict() for r in results], indent=1)
        arguments.json.write_text(text)
    print(f'code {arguments.code}, stride {arguments.stride}; millimetres')
    print(f'{arguments.seeds} photographs a kind')
    print(f'{"":36}' + ''.join(f'{column:>9}' for column in (*COLUMNS, 'verdict')))
    for name in dict.fromkeys(r.kind for r in results):
        of_kind = [r for r in results if r.kind == name]
        for method in dict.fromkeys(r.method for r in of_kind):
            some = [r for r in of_kind if r.method == method]
            lines = verdict(name, some, of_kind)
            cells = [*row(some), 'kept' if not lines else f'{len(lines)} not']
            print(f'{name:18}{method:18}' + ''.join(f'{value:>9}' for value in cells))
            for line in lines:
                print(f'{"":20}{line}')
            if arguments.dent_free:
                area = sum(r.area for r in some if not math.isnan(r.area))
                false = sum(len(r.false_dents) + len(r.false_bumps) for r in some)
                print(f'{"":20}{false} false in {area:.2f} m2: {false / max(area, 1e-9):.2f} a m2')
            if arguments.details:
                show(some)


def show(results: list[Figures]) -> None:
    """Every dent, and what is false."""
    for r in results:
        for d in r.dents:
            print(
                f'{"":22}{r.seed} {d.kind} {d.depth:.3f} x {d.length:.1f} x {d.width:.1f}: '
                f'cloud {d.cloud_error:+.3f} ({d.cloud_sigma:.3f}); '
                + (
                    f'{d.found_kind} {d.depth_error:+.3f} ({d.depth_u:.3f}), '
                    f'{d.length_error:+.2f} ({d.length_u:.2f}), '
                    f'{d.width_error:+.2f} ({d.width_u:.2f})'
                    if d.found
                    else 'not found'
                )
            )
        for text in (*r.false_dents, *r.false_bumps):
            print(f'{"":22}{r.seed} FALSE {text}')


if __name__ == '__main__':
    main()
