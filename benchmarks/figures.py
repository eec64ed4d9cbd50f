"""The gate: what the package measures, how sure it is, how large it is and how fast.

python benchmarks/figures.py                                  # figures.json and docs/results.md
python benchmarks/figures.py --against figures.json           # what is worse? 1 if anything is
python benchmarks/figures.py --against figures.json --seed 7  # the same, of other draws
python benchmarks/figures.py --against figures.json --short   # a part of the same draws

Each row is measured on several draws, in two processes; a seed decides all of them, to the last
digit. Runs of one seed tell how many figures are equal; speeds are apart, in multiples of a
Fourier transform. --against writes nothing unless --output names a folder.
"""

from __future__ import annotations

import argparse
import json
import math
import multiprocessing
import os
import re
import sys
from collections import defaultdict
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from multiprocessing.pool import Pool
from pathlib import Path
from typing import Any

import cv2
from against import FIGURES, Run, report
from calibrations import calibration
from given_photographs import SHARED, given
from given_photographs import names as given_names
from measures import CHOSEN, Figures, photographed
from page import page
from photographs import KINDS, PAPER, PRINTS, SHAPES
from sizes import sizes
from speeds import speeds
from surveys import comparison, pairs, strip
from tqdm import tqdm

import ftp_dent_ros

ROOT = Path(__file__).resolve().parents[1]
# A process does so many draws: what is kept of their rigs is freed with it.
FRESH = 40
NAME, PAGE = 'figures.json', 'docs/results.md'

# Of a draw that failed before there was anything to measure.
NOT_MADE = 'not made'

Measure = Callable[[str, int, int], dict[str, Figures]]
Task = tuple[str, str, int]


@dataclass(frozen=True)
class Group:
    """Rows that are measured alike: each name, so many draws; in short some, of fewer draws."""

    measure: Measure
    names: tuple[str, ...]
    draws: int
    short: tuple[str, ...] = ()
    short_draws: int = 1


# What takes longest is first: it begins first, so that both processes end together.
GROUPS = {
    'calibration': Group(calibration, ('8 poses of a board',), 4),
    'survey, strip': Group(strip, ('12 clouds',), 4),
    'survey, pairs': Group(pairs, ('3 clouds',), 4, ('3 clouds',)),
    'survey, compared': Group(comparison, ('60 dents',), 6),
    'given': Group(given, tuple(given_names()), 1),
    'paper': Group(partial(photographed, PAPER), tuple(PAPER), 4, ('A, 60 cm',)),
    'photographs': Group(
        partial(photographed, KINDS),
        tuple(KINDS),
        6,
        ('clean', 'dirt of 25 %', 'lap across', 'sun edge'),
        3,
    ),
    'prints': Group(partial(photographed, PRINTS), tuple(PRINTS), 4),
    'dents': Group(partial(photographed, SHAPES), tuple(SHAPES), 6, ('gaussian',), 4),
}


def tasks(short: bool, only: str) -> list[Task]:
    """Group, name and number of every draw."""
    return [
        (group, name, draw)
        for group, each in GROUPS.items()
        for name in (each.short if short else each.names)
        if only in f'{group}/{name}'
        for draw in range(each.short_draws if short else each.draws)
    ]


def done(task: Task, seed: int, method: str) -> tuple[Task, dict[str, Figures]]:
    """One draw; whatever it raises is a figure."""
    group, name, draw = task
    cv2.setNumThreads(1)
    if method:
        CHOSEN['method'] = method
    try:
        return task, GROUPS[group].measure(name, seed, draw)
    except Exception as reason:
        return task, {NOT_MADE: {'refusals': 1, 'reason': type(reason).__name__}}


def processes(count: int) -> Pool:
    """Fresh ones, which have one thread each."""
    for name in ('OPENBLAS', 'OMP', 'MKL'):
        os.environ[f'{name}_NUM_THREADS'] = '1'
    return multiprocessing.get_context('spawn').Pool(count, maxtasksperchild=FRESH)


def measured(
    todo: list[Task], seed: int, jobs: int, method: str
) -> dict[Task, dict[str, Figures]]:
    """All draws."""
    with processes(jobs) as pool:
        results = pool.imap_unordered(partial(done, seed=seed, method=method), todo)
        return dict(tqdm(results, total=len(todo), unit='draw', smoothing=0))


def timed(seed: int) -> dict[str, float]:
    """Speeds, in a process that nothing else is done in."""
    with processes(1) as pool:
        return pool.apply(speeds, (seed,))


def gathered(todo: Iterable[Task], results: dict[Task, dict[str, Figures]]) -> Run:
    """Rows of figures, draw by draw, in the order of the tasks; None where there is no number."""
    made: dict[str, list[dict[str, Figures]]] = defaultdict(list)
    for task in todo:
        made[f'{task[0]}/{task[1]}'].append(results[task])
    draws = {
        f'{name}/{way}': [ways.get(way) or ways[NOT_MADE] for ways in each]
        for name, each in made.items()
        for way in dict.fromkeys(way for ways in each for way in ways)
        if way != NOT_MADE or all(NOT_MADE in ways for ways in each)
    }
    rows: dict[str, dict[str, list[Any]]] = {}
    reasons: dict[str, list[str]] = {}
    for row, each in draws.items():
        known = [name for name in FIGURES if any(name in figures for figures in each)]
        rows[row] = {name: [_number(figures.get(name)) for figures in each] for name in known}
        if any('reason' in figures for figures in each):
            reasons[row] = [figures.get('reason', '') for figures in each]
    return {'rows': rows, 'reasons': reasons}


def _number(value: Any) -> float | None:
    return None if value is None or not math.isfinite(value) else float(value)


def text(run: Run) -> str:
    """JSON, a figure a line."""
    lists = re.compile(r'\[[^][]*\]')
    return lists.sub(_on_one_line, json.dumps(run, indent=1)) + '\n'


def _on_one_line(match: re.Match[str]) -> str:
    return f'[{" ".join(match[0][1:-1].split())}]'


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--seed', type=int, default=1, help='of all draws')
    parser.add_argument('--short', action='store_true', help='a few rows and draws: half a minute')
    parser.add_argument('--only', default='', help='part of the names of rows wanted')
    parser.add_argument('--method', default='', help='of photographs, instead of the default')
    parser.add_argument('--jobs', type=int, default=2, help='processes')
    parser.add_argument('--against', type=Path, help='figures of another run')
    parser.add_argument('--read', type=Path, help='figures to show or compare: measures nothing')
    parser.add_argument('--output', type=Path, help='folder of figures.json and its page')
    arguments = parser.parse_args()
    part = arguments.short or bool(arguments.only)
    before = json.loads(arguments.against.read_text()) if arguments.against else None
    if arguments.read:
        run = json.loads(arguments.read.read_text())
    else:
        if not GROUPS['given'].names:
            print(f'{SHARED} has no photographs: those made elsewhere are left out')
        todo = tasks(arguments.short, arguments.only)
        results = measured(todo, arguments.seed, arguments.jobs, arguments.method)
        run = {'seed': arguments.seed, 'part': part, **gathered(todo, results)}
        package = Path(ftp_dent_ros.__file__).parent
        run['sizes'] = {} if part else sizes(package)
        run['speeds'] = {} if part else timed(arguments.seed)
    if arguments.output:
        arguments.output.mkdir(parents=True, exist_ok=True)
        (arguments.output / NAME).write_text(text(run))
        (arguments.output / Path(PAGE).name).write_text(page(run))
    elif before is None and not part and not arguments.method:
        (ROOT / NAME).write_text(text(run))
        (ROOT / PAGE).write_text(page(run))
    if before is None:
        return 0
    lines, well = report(run, before)
    print('\n'.join(lines))
    return 0 if well else 1


if __name__ == '__main__':
    sys.exit(main())
