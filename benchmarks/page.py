"""The page of a run's figures, docs/results.md."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Iterator

import numpy as np
from against import ALL, FIGURES, Draws, Run, with_means

_HEAD = """\
# What it measures

`make figures` writes this page: do not edit. Values are means of so many draws, ± their standard
deviation; `all` is the mean of a table's rows, and of "off" their median. Everything is simulated
but what is `given`, which was made elsewhere: `eval` by another renderer, `real` with a camera; in
`real/calibration` the fringes are drawn, and the board, its light and the camera's noise are real.

- Coverage: of the lit skin. MAE, and what 95 % of the errors are below: along the rays.
- Error / sigma: root mean square of the points' errors over their stated uncertainty. Rms less:
  how much less the root mean square of the errors is without the 5 % that are least sure.
- Other fringe: points that are off by more than half of what lies between neighbouring fringes.
- Found: of the dents in view. Findable: of those as wide as the smallest dent that are deeper
  than what is stated as findable at their place; they are listed as dents or creases, or in doubt
  as anything else, or not at all. Two dents without a saddle of
  a tenth of the lesser depth between them are one, as deep, long and wide as their sum.
- False: dents, bumps, creases and gouges in a photograph where there is none; in doubt: what else
  is listed there. Depth, length, width off: the median error over the true one.
- / u: root mean square of errors over their stated uncertainty.
- Refused: part of the draws that give no result.
- `stripe` and `contrast` are the patterns; `virtual-reference` is the paper's method.
"""
_SIZES = """\
## Sizes

Of the package, by room. Statements are those of the syntax tree; choices are branches,
comparisons, operands of `and` and `or`, and filters; numbers are literals other than -2 to 2;
constants are numbers with a name; wide functions have more than six parameters; single modules
are imported by one other.
"""
_SPEEDS = """\
## Speeds

Processor time of one thread for a photograph of 1280x720 at stride 2, in multiples of one rfft
and irfft of its rows.
"""


def page(run: Run) -> str:
    """Markdown of a run."""
    return '\n'.join(_parts(run)).rstrip() + '\n'


def _parts(run: Run) -> Iterator[str]:
    yield _HEAD
    tables: dict[tuple[str, str], dict[str, Draws]] = defaultdict(dict)
    for row, figures in with_means(run['rows']).items():
        group, *name, way = row.split('/')
        tables[group, way]['/'.join(name)] = figures
    last = ''
    for (group, way), rows in tables.items():
        if group != last:
            yield f'## {group[0].upper()}{group[1:]}\n'
            last = group
        draws = max(len(each) for figures in rows.values() for each in figures.values())
        yield f'### {way}: {draws} draw{"s" * (draws > 1)}\n'
        shown = [name for name in FIGURES if any(_known(f.get(name)) for f in rows.values())]
        yield from _table(
            ('', *(FIGURES[name].label for name in shown)),
            (
                (name, *(_cell(figure, f.get(figure)) for figure in shown))
                for name, f in rows.items()
            ),
        )
    if run['reasons']:
        yield '## Refused\n'
        reasons = ((row, _counted(reasons)) for row, reasons in run['reasons'].items())
        yield from _table(('', 'reasons'), reasons)
    if run['sizes']:
        yield _SIZES
        columns = tuple(run['sizes'][ALL])
        rows = ((room, *map(str, counts.values())) for room, counts in run['sizes'].items())
        yield from _table(('', *columns), rows)
    if run['speeds']:
        yield _SPEEDS
        yield from _table(('', 'times'), ((k, f'{v:.1f}') for k, v in run['speeds'].items()))


def _table(head: tuple[str, ...], rows) -> Iterator[str]:
    yield f'| {" | ".join(head)} |'
    yield f'|{" --- |" * len(head)}'
    for row in rows:
        yield f'| {" | ".join(row)} |'
    yield ''


def _known(draws: list[float | None] | None) -> bool:
    return draws is not None and any(each is not None for each in draws)


def _cell(figure: str, draws: list[float | None] | None) -> str:
    """Mean and standard deviation, as many digits as that tells."""
    if not _known(draws):
        return ''
    values = FIGURES[figure].scale * np.array([each for each in draws if each is not None])
    mean, spread = float(np.mean(values)), float(np.std(values, ddof=1)) if len(values) > 1 else 0
    # Two digits of the spread, or three of what does not scatter.
    size = spread or abs(mean) / 10
    digits = min(max(1 - math.floor(math.log10(size)), 0), 6) if size else 0
    if mean == round(mean) and not spread:
        digits = 0
    return f'{mean:.{digits}f}' + (f' ± {spread:.{digits}f}' if spread else '')


def _counted(reasons: list[str]) -> str:
    counts = Counter(filter(None, reasons))
    return ', '.join(f'{reason} ({count} of {len(reasons)})' for reason, count in counts.items())
