"""Figures of two runs beside each other: which are equal, and which are worse than by chance."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

# Of a normal distribution: chance that a mean lies three standard errors to the worse side. It
# is that of any figure at all where two runs had other draws; of the same draws nothing is drawn
# anew, and it is that of each figure, whose scatter is that between the draws.
SIGNIFICANCE = 0.00135
# What is worse by less than this part is nothing, nor of what is photographed but once.
NEGLIGIBLE, ONCE = 0.02, 0.05
# Multiples of the yardstick that grow by this factor are slower, whatever else the machine did.
SLOWER = 1.5
ALL = 'all'

Draws = dict[str, list[float | None]]
Rows = dict[str, Draws]
Run = dict[str, Any]


@dataclass(frozen=True)
class Meaning:
    """What a figure is.

    Attributes
    ----------
    label : str
        On the page.
    bad : callable
        Of an array of values: what is larger where they are worse.
    trifle : float
        Of that: what is worse by less is nothing.
    scale : float
        From the figure to the page.
    middle : callable
        Of a group's rows: their mean, or the median of medians.
    """

    label: str
    bad: Callable[[NDArray], NDArray]
    trifle: float = 0.0
    scale: float = 1.0
    middle: Callable[[list[float]], Any] = np.mean


def _more(values: NDArray) -> NDArray:
    """More is better."""
    return -values


def _less(values: NDArray) -> NDArray:
    """Less is better."""
    return values


def _near_one(values: NDArray) -> NDArray:
    """One is best."""
    return np.abs(np.log(np.maximum(values, 1e-9)))


def _up_to_one(values: NDArray) -> NDArray:
    """One and less is good: of few errors many are small by chance."""
    return np.maximum(values, 1.0)


FIGURES = {
    'coverage': Meaning('coverage, %', _more, 0.002, 100),
    'mae_mm': Meaning('MAE, mm', _less, 5e-5),
    'p95_mm': Meaning('95 % below, mm', _less, 2e-4),
    'mae_px': Meaning('MAE, px', _less, 0.01),
    'p95_px': Meaning('95 % below, px', _less, 0.03),
    'wrong_order': Meaning('other fringe, %', _less, 0.002, 100),
    'error_over_sigma': Meaning('error / sigma', _near_one, 0.02),
    'rms_lowered': Meaning('rms less, %', _more, 0.02, 100),
    'wild': Meaning('beyond 4 sigma, %', _less, 0.002, 100),
    'found': Meaning('found, %', _more, 0.0, 100),
    'findable_listed': Meaning('findable: listed, %', _more, 0.0, 100),
    'findable_doubted': Meaning('findable: in doubt, %', _less, 0.0, 100),
    'findable_missed': Meaning('findable: not listed, %', _less, 0.0, 100),
    'false': Meaning('false', _less),
    'doubtful': Meaning('in doubt', _less),
    'depth_off': Meaning('depth off, %', _less, 0.002, 100, np.median),
    'length_off': Meaning('length off, %', _less, 0.002, 100, np.median),
    'width_off': Meaning('width off, %', _less, 0.002, 100, np.median),
    'depth_over_u': Meaning('depth / u', _up_to_one, 0.05),
    'length_over_u': Meaning('length / u', _up_to_one, 0.05),
    'width_over_u': Meaning('width / u', _up_to_one, 0.05),
    'normal_mm': Meaning('along the normal, mm', _less, 5e-5),
    'along_mm': Meaning('along the skin, mm', _less, 1e-3),
    'turn_degrees': Meaning('turned, degrees', _less, 5e-5),
    'pose_over_u': Meaning('pose / u', _up_to_one, 0.05),
    'untold': Meaning('not resolved', _less),
    'pairs': Meaning('pairs', _more),
    'left_out': Meaning('left out', _less),
    'poses_refused': Meaning('poses refused', _less),
    'camera_px': Meaning('camera, px', _less, 5e-4),
    'projector_px': Meaning('projector, px', _less, 5e-4),
    'stereo_px': Meaning('both, px', _less, 5e-4),
    'right': Meaning('judged right', _more),
    'open': Meaning('left open', _less),
    'wrong': Meaning('judged wrong', _less),
    'within_95': Meaning('within 95 %, %', _more, 0.02, 100),
    'refusals': Meaning('refused', _less),
}


@dataclass(frozen=True)
class Worse:
    """A figure that is worse: means before and now, and the chance that it is not."""

    row: str
    figure: str
    before: float
    now: float
    chance: float

    def __str__(self) -> str:
        label = FIGURES[self.figure].label
        values = f'{self.before:.6g} -> {self.now:.6g}'
        return f'{self.row:48}{label:22}{values:28} chance {self.chance:.1e}'


def common(now: Rows, before: Rows, same: bool) -> tuple[Rows, Rows]:
    """What both have: rows and figures, and of the same draws so many as both have."""
    both: tuple[Rows, Rows] = ({}, {})
    for row in sorted(now.keys() & before.keys()):
        for figure in sorted(now[row].keys() & before[row].keys()):
            values = now[row][figure], before[row][figure]
            count = min(map(len, values)) if same else None
            for rows, each in zip(both, values, strict=True):
                rows.setdefault(row, {})[figure] = each[:count]
    return both


def equal(now: Rows, before: Rows) -> tuple[int, int]:
    """How many figures are the same to the last digit in all draws, and of how many."""
    same = [now[row][figure] == before[row][figure] for row in now for figure in now[row]]
    return sum(same), len(same)


def with_means(rows: Rows) -> Rows:
    """And rows of the means of a group, under each of its patterns or methods."""
    groups: dict[tuple[str, str], list[Draws]] = defaultdict(list)
    for row, figures in rows.items():
        group, *_, way = row.split('/')
        groups[group, way].append(figures)
    means: Rows = {}
    for (group, way), members in groups.items():
        names = sorted({name for figures in members for name in figures})
        if len(members) > 1:
            means[f'{group}/{ALL}/{way}'] = {
                name: _middle(name, [figures[name] for figures in members if name in figures])
                for name in names
            }
    return rows | means


def _middle(name: str, draws: list[list[float | None]]) -> list[float | None]:
    """Of a figure over rows, draw by draw."""
    count = min(map(len, draws))
    columns = ([each[i] for each in draws if each[i] is not None] for i in range(count))
    return [float(FIGURES[name].middle(column)) if column else None for column in columns]


def worse(now: Run, before: Run) -> list[Worse]:
    """What is worse than the scatter between draws, the least likely first."""
    same = now['seed'] == before['seed']
    both = common(now['rows'], before['rows'], same)
    rows = [with_means(each) for each in both]
    every = with_means({row: before['rows'][row] for row in both[1]})
    found = [
        each
        for row in rows[0]
        for figure in rows[0][row]
        if (each := _compared(row, figure, *rows, every, same)) is not None
    ]
    count = 1 if same else sum(map(len, rows[0].values()))
    return sorted(
        (each for each in found if each.chance * count < SIGNIFICANCE), key=lambda w: w.chance
    )


def _compared(
    row: str, figure: str, now: Rows, before: Rows, every: Rows, same: bool
) -> Worse | None:
    meaning = FIGURES[figure]
    values = [_numbers(rows[row][figure]) for rows in (now, before)]
    if not all(map(len, values)):
        return None
    bad = [meaning.bad(each) for each in values]
    means = [float(np.mean(each)) for each in bad]
    more = means[0] - means[1]
    if more <= max(meaning.trifle, NEGLIGIBLE * abs(means[1])):
        return None
    # Of the same draws those before tell the scatter: those now are none of their own.
    scattered = [meaning.bad(_numbers(every[row][figure]))] if same else bad
    freedom = sum(len(each) - 1 for each in scattered)
    if freedom:
        variance = sum(float(np.sum((e - np.mean(e)) ** 2)) for e in scattered) / freedom
        error = math.sqrt(variance * sum(1 / len(each) for each in bad))
        chance = float(stats.t.sf(more / error, freedom)) if error else 0.0
    else:
        chance = 0.0 if more > ONCE * abs(means[1]) else 1.0
    shown = [float(np.mean(each)) for each in values]
    return Worse(row, figure, shown[1], shown[0], chance)


def _numbers(draws: list[float | None]) -> NDArray[np.float64]:
    return np.array([each for each in draws if each is not None], float)


def slower(now: dict[str, float], before: dict[str, float]) -> Iterator[str]:
    """Lines on what takes longer by more than `SLOWER`."""
    for name in now.keys() & before.keys():
        if now[name] > SLOWER * before[name]:
            yield f'{name}: {before[name]:.1f} -> {now[name]:.1f} times the yardstick'


def report(now: Run, before: Run) -> tuple[list[str], bool]:
    """Lines on two runs, and whether all is well."""
    same = now['seed'] == before['seed']
    both = common(now['rows'], before['rows'], same)
    lines = []
    if same:
        lines.append('equal: {} of {} figures'.format(*equal(*both)))
    for name, a, b in (('now', now, before), ('before', before, now)):
        alone = sorted(a['rows'].keys() - b['rows'].keys())
        if alone and not (name == 'before' and now['part']):
            lines.append(f'only {name}: {", ".join(alone)}')
    bad = [*map(str, worse(now, before)), *sorted(slower(now['speeds'], before['speeds']))]
    lines += [f'worse: {line}' for line in bad] or ['nothing is worse']
    if now['sizes'] and before['sizes']:
        old, new = before['sizes'][ALL], now['sizes'][ALL]
        sizes = (f'{new[name]} {name} ({new[name] - old[name]:+d})' for name in new)
        lines.append(f'sizes: {", ".join(sizes)}')
    return lines, not bad
