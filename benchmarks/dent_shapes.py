"""Dents of every shape, photographed: median errors, and the share of 95 % intervals that hold.

python benchmarks/dent_shapes.py [--count 60] [--only cosine,cap] [--without gouge] [--jobs 2]
                                 [--dirt 0.25] [--waviness 0.1] [--json shapes.json]
python benchmarks/dent_shapes.py --only gouge --paint-only    # their marks, without a groove

8 to 100 mm, 0.1 to 5 mm deep, 0.6 to 1.2 m away, on skin that is flat or of 2 m radius. Errors are
medians of the signed errors over the true size; "held" is the share of the 95 % intervals. Of a
double dent it is told whether it is two, one with a word, or one without.
"""

from __future__ import annotations

import argparse
import json
import math
import multiprocessing
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from kind_figures import METHODS, reconstructor
from kind_scenes import CAMERA, PATTERN, KindScene, by_contour, scene
from tqdm import tqdm

from ftp_dent_ros.dents.dent import MeasuredDent
from ftp_dent_ros.errors import FtpDentError
from ftp_dent_ros.evaluation.scenes import make_rig
from ftp_dent_ros.inspection.measuring.inspection import inspect
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.simulation import Dent, Dirt, Paint, Panel, Rivet, waviness
from ftp_dent_ros.simulation.dents import (
    SMOOTH,
    Cap,
    Crater,
    FlatBottomed,
    Gaussian,
    Plate,
    RaisedCosine,
    Shape,
    Valley,
)
from ftp_dent_ros.simulation.truth import TrueDent, match_truth, true_dents

DISTANCES = 0.6, 0.8, 1.0, 1.2
# A dent is no deeper than this part of its width: skin folds before.
_STEEPEST = 1 / 12
# No dent has a depth of 0, metres.
_FLAT = 1e-9
SIZES = 'depth', 'length', 'width'
# Off a dent's middle that is taken for it at least, metres.
_LEAST_REACH = 0.006

Family = Callable[[np.random.Generator], tuple[Dent, ...]]


@dataclass
class Row:
    """One true dent and what was made of it, millimetres."""

    family: str
    distance: float
    kind: str
    depth: float
    length: float
    width: float
    found: str = ''
    reason: str = ''
    is_cut: bool = False
    depth_error: float = math.nan
    depth_u: float = math.nan
    length_error: float = math.nan
    length_u: float = math.nan
    width_error: float = math.nan
    width_u: float = math.nan


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """Between two positive numbers, each octave as likely."""
    return float(np.exp(rng.uniform(math.log(low), math.log(max(low, high)))))


def rounded(shape: Callable[[np.random.Generator], Shape], low: float = 0.008) -> Family:
    """Dents of a shape, from `low` to 100 mm long."""

    def family(rng: np.random.Generator) -> tuple[Dent, ...]:
        length = log_uniform(rng, low, 0.1)
        width = max(length * rng.uniform(0.5, 1), 0.008)
        depth = log_uniform(rng, 1e-4, min(5e-3, width * _STEEPEST))
        length = max(length, width)
        return (by_contour(0, 0, length, width, depth, rng.uniform(0, 3), shape(rng)),)

    return family


def crease(rng: np.random.Generator) -> tuple[Dent, ...]:
    """0.3 to 3 mm deep, 5 to 15 mm wide, sharp at its bottom."""
    width = rng.uniform(0.006, 0.016)
    depth = log_uniform(rng, 3e-4, 0.25 * width)
    blunt = Valley(float(rng.uniform(0.03, 0.15)))
    return (Dent(0, 0, rng.uniform(0.03, 0.1), width, depth, rng.uniform(0, 3), blunt),)


def gouge(rng: np.random.Generator) -> tuple[Dent, ...]:
    """A groove 3 to 8 mm wide, with a light mark."""
    width = rng.uniform(0.003, 0.008)
    return (
        Dent(
            0,
            0,
            rng.uniform(0.015, 0.06),
            width,
            log_uniform(rng, 2e-4, 0.1 * width + 2e-4),
            rng.uniform(0, 3),
            Valley(float(rng.uniform(0.1, 0.3)), 'gouge'),
            float(rng.uniform(1.15, 1.25)),
        ),
    )


def double(rng: np.random.Generator) -> tuple[Dent, ...]:
    """Two dents whose centres are 0.4 to 1.2 widths apart."""
    width = log_uniform(rng, 0.015, 0.05)
    depth = log_uniform(rng, 2e-4, min(2e-3, width * _STEEPEST))
    apart, towards = width * rng.uniform(0.4, 1.2), rng.uniform(0, 2 * math.pi)
    half = apart / 2 * np.array([math.cos(towards), math.sin(towards)])
    return tuple(
        by_contour(*(sign * half), width * grow, width * grow, depth * rng.uniform(0.6, 1))
        for sign, grow in ((1, 1.0), (-1, rng.uniform(0.8, 1)))
    )


FAMILIES: dict[str, Family] = {
    'eq. 18': rounded(lambda rng: SMOOTH),
    'cosine': rounded(lambda rng: RaisedCosine()),
    'gaussian': rounded(lambda rng: Gaussian()),
    'cap': rounded(lambda rng: Cap()),
    'flat': rounded(lambda rng: FlatBottomed(rng.uniform(0.3, 0.7))),
    'crater': rounded(lambda rng: Crater(rng.uniform(0.1, 0.3), rng.uniform(0.6, 0.8)), 0.015),
    'oil can': rounded(lambda rng: Plate(), 0.06),
    'crease': crease,
    'gouge': gouge,
    'double': double,
}


@dataclass(frozen=True)
class Task:
    """One photograph to take."""

    seed: int
    families: tuple[str, ...]
    distance: float
    dirt: float
    waviness: float
    stride: int
    method: str
    paint_only: bool = False


def photograph(task: Task) -> tuple[KindScene, list[tuple[str, tuple[Dent, ...]]]]:
    """A skin with dents of families, apart from one another as far as they go."""
    rng = np.random.default_rng(task.seed)
    rig = make_rig(task.distance, 0.3 * task.distance, CAMERA, 1890.0)
    reach = np.array([0.20, 0.10]) * task.distance
    placed: list[tuple[str, tuple[Dent, ...]]] = []
    discs: list[tuple[float, float, float]] = []
    for name in task.families:
        dents = FAMILIES[name](rng)
        radius = max(math.hypot(d.x, d.y) + d.size_at(0.1)[0] / 2 for d in dents)
        for _ in range(200):
            x, y = rng.uniform(-1, 1, 2) * np.maximum(reach - radius, 0.1 * reach)
            if all(math.hypot(x - a, y - b) > 1.6 * (radius + r) for a, b, r in discs):
                discs.append((x, y, radius))
                moved = tuple(replace(d, x=d.x + float(x), y=d.y + float(y)) for d in dents)
                placed.append((name, moved))
                break
    tilt = np.radians([*rng.uniform(-8, 8, 2), 0])
    marks = (Dirt(task.dirt, seed=int(rng.integers(1 << 30))),) if task.dirt else ()
    waves = (
        waviness(task.waviness, rng.uniform(0.08, 0.2), int(rng.integers(1 << 30)))
        if task.waviness
        else ()
    )
    # Beside the dents: a row of rivets along the edge of the picture.
    rivets = tuple(Rivet(-0.3 + 0.025 * i, 0.125 * task.distance) for i in range(25))
    panel = Panel(
        Pose.from_rpy(tilt, (0, 0, task.distance)),
        (-2, 2, -2, 2),
        float(rng.choice([0.0, 2.0])),
        Paint(roughness=float(rng.choice([0.0, 0.25])), marks=marks),
        tuple(d for _, dents in placed for d in dents),
        rivets if rng.integers(2) else (),
        waves,
    )
    return scene(panel, rig=rig), placed


def without_depth(one: KindScene) -> KindScene:
    """The same paint and marks on a skin whose dents are all but flat."""
    panels = tuple(
        replace(panel, dents=tuple(replace(dent, depth=_FLAT) for dent in panel.dents))
        for panel in one.panels
    )
    return replace(one, panels=panels)


def measured(task: Task) -> tuple[list[Row], list[str], int]:
    """Rows of a photograph's dents, what is false, and how many others are on nothing."""
    cv2.setNumThreads(1)
    one, placed = photograph(task)
    if task.paint_only:
        one, placed = without_depth(one), []
    names = [name for name, dents in placed for _ in dents]
    truths = [] if task.paint_only else true_dents(one.surface)
    rows = [
        Row(name, task.distance, t.kind, 1e3 * t.depth, 1e3 * t.length, 1e3 * t.width)
        for name, t in zip(names, truths, strict=True)
    ]
    try:
        method = reconstructor(one.rig, PATTERN, task.method, task.stride)
        found = inspect(method.measure(one.photograph(task.seed), True).cloud)
    except FtpDentError as reason:
        return rows, [f'seed {task.seed}: {reason}'], 0
    left = [m for m in (*found.dents, *found.others) if m.kind != 'step']
    pairs = match_truth(
        [m.position for m in left],
        [truth.position for truth in truths],
        [max(_LEAST_REACH, truth.length / 2) for truth in truths],
    )
    for true, best in pairs.items():
        _fill(rows[true], truths[true], left[best])
    on_nothing = [
        m
        for index, m in enumerate(left)
        if index not in pairs.values()
        and all(np.linalg.norm(m.position - t.position) > t.length for t in truths)
    ]
    false = [
        f'seed {task.seed}: {m.kind} {1e3 * m.depth.value:.3f}'
        for m in on_nothing
        if m.kind != 'other'
    ]
    # Where two became one, the other row has what was said about it.
    for row, truth in zip(rows, truths, strict=True):
        if row.family == 'double' and not row.found:
            off = [float(np.linalg.norm(m.position - truth.position)) for m in left]
            if left and min(off) < max(_LEAST_REACH, truth.length):
                row.reason = left[int(np.argmin(off))].reason
    return rows, false, len(on_nothing) - len(false)


def _fill(row: Row, truth: TrueDent, m: MeasuredDent) -> None:
    row.found, row.reason, row.is_cut = m.kind, m.reason, m.is_cut
    for name in SIZES:
        value = getattr(m, name)
        setattr(row, f'{name}_error', 1e3 * (value.value - getattr(truth, name)))
        setattr(row, f'{name}_u', 1e3 * value.uncertainty)


def tasks(arguments: argparse.Namespace) -> list[Task]:
    """Photographs of two or three dents until each family has its count."""
    wanted = [
        name
        for name in FAMILIES
        if any(part in name for part in arguments.only.split(','))
        and not (arguments.without and any(p in name for p in arguments.without.split(',')))
    ]
    rng = np.random.default_rng(arguments.seed)
    pool = [name for name in wanted for _ in range(arguments.count)]
    pool = [pool[i] for i in rng.permutation(len(pool))]
    # Three a photograph; the largest may leave one out, which is then not counted.
    return [
        Task(
            int(arguments.seed * 100_000 + start),
            tuple(pool[start : start + 3]),
            float(rng.choice(DISTANCES)),
            arguments.dirt,
            arguments.waviness / 1e3,
            arguments.stride,
            arguments.method,
            arguments.paint_only,
        )
        for start in range(0, len(pool), 3)
    ]


def line(rows: list[Row]) -> str:
    """A family."""
    listed = [r for r in rows if r.found]
    whole = [r for r in listed if not r.is_cut and math.isfinite(r.length_error)]
    cells = [
        str(len(rows)),
        f'{100 * len(listed) / len(rows):.0f}',
        f'{100 * np.mean([r.found == r.kind for r in listed]):.0f}' if listed else '',
    ]
    for name in SIZES:
        errors = np.array([getattr(r, f'{name}_error') / getattr(r, name) for r in whole])
        ratios = np.array([getattr(r, f'{name}_error') / getattr(r, f'{name}_u') for r in whole])
        if len(whole):
            cells += [
                f'{100 * np.median(errors):+.1f}',
                f'{100 * np.median(np.abs(errors)):.1f}',
                f'{100 * np.mean(np.abs(ratios) < 1.96):.0f}',
            ]
        else:
            cells += ['', '', '']
    return ''.join(f'{cell:>8}' for cell in cells)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--count', type=int, default=60, help='dents a family')
    parser.add_argument('--only', default='', help='parts of the families wanted, with commas')
    parser.add_argument('--without', default='', help='parts of those held out, with commas')
    parser.add_argument('--dirt', type=float, default=0.0, help='contrast')
    parser.add_argument('--waviness', type=float, default=0.0, help='amplitude, mm')
    parser.add_argument('--seed', type=int, default=2031)
    parser.add_argument('--stride', type=int, default=2)
    parser.add_argument(
        '--paint-only', action='store_true', help='marks of gouges that are none: all is false'
    )
    parser.add_argument('--method', default='default', choices=METHODS)
    parser.add_argument('--jobs', type=int, default=1)
    parser.add_argument('--json', type=Path, help='where all rows go')
    arguments = parser.parse_args()
    rows: list[Row] = []
    false: list[str] = []
    doubtful = 0
    todo = tasks(arguments)
    with multiprocessing.get_context('spawn').Pool(arguments.jobs) as pool:
        done = tqdm(pool.imap(measured, todo), total=len(todo), unit='photograph')
        for some, more, others in done:
            rows += some
            false += more
            doubtful += others
    if arguments.json:
        arguments.json.write_text(json.dumps([asdict(r) for r in rows], indent=1))
    head = 'n', 'found', 'kind', 'depth', '|d|', 'held', 'length', '|l|', 'held', 'width', '|w|'
    print(f'per cent; stride {arguments.stride}, dirt {arguments.dirt:g}')
    print(f'{"":12}' + ''.join(f'{name:>8}' for name in (*head, 'held')))
    for name in FAMILIES:
        some = [r for r in rows if r.family == name]
        if some and name != 'double':
            print(f'{name:12}{line(some)}')
    doubles = [r for r in rows if r.family == 'double']
    pairs = list(zip(doubles[::2], doubles[1::2], strict=True))
    if pairs:
        two = sum(bool(a.found and b.found) for a, b in pairs)
        one = [(a, b) for a, b in pairs if bool(a.found) != bool(b.found)]
        told = sum(bool(a.reason or b.reason) for a, b in one)
        print(
            f'double      {len(pairs)} pairs: {two} as two, {told} as one that is flagged, '
            f'{len(one) - told} as one without a word, {len(pairs) - two - len(one)} not found'
        )
    print(f'false: {len(false)} in {len(todo)} photographs: {"; ".join(false[:8])}')
    print(f'others on nothing: {doubtful}')


if __name__ == '__main__':
    main()
