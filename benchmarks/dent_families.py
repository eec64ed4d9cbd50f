"""Whether intervals hold for shapes that nothing was chosen on: each family left out in turn.

python benchmarks/dent_families.py ROWS.json [MORE.json ...]

Rows are those of `benchmarks/dent_shapes.py --json`. For each family and each of depth, length
and width it is told how many of the 95 % intervals hold as they are stated, and how many would
with the factor that the other families ask for: the smallest one with which 95 % of theirs hold,
each family counting alike. The rule for the factors in `ftp_dent_ros.inspection.measuring.sizes`:
they are multiplied by the largest of a column ("further factor"). Below, the standard deviation of
the normalised errors.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.dents.dent import COVERAGE

SIZES = 'depth', 'length', 'width'
_HELD = 0.95
# Dents of a family that say something of it.
_FEWEST = 5

Ratios = dict[str, NDArray[np.float64]]


def ratios_of(rows: Sequence[dict], name: str) -> Ratios:
    """Normalised errors of a size by family, of whole dents that are told without a doubt.

    Not of double dents: one that is told for two has sizes of neither (`dent_shapes.py` counts
    them).
    """
    found: dict[str, list[float]] = {}
    for row in rows:
        if row['found'] in ('', 'other') or row['is_cut'] or row['family'] == 'double':
            continue
        ratio = row[f'{name}_error'] / row[f'{name}_u']
        if math.isfinite(ratio):
            found.setdefault(row['family'], []).append(ratio)
    return {f: np.array(values) for f, values in found.items() if len(values) >= _FEWEST}


def factor_of(families: Sequence[NDArray[np.float64]]) -> float:
    """Smallest factor with which 95 % hold, each family counting alike."""
    values = np.concatenate([np.abs(each) for each in families])
    weights = np.concatenate([np.full(len(each), 1 / len(each)) for each in families])
    order = np.argsort(values)
    share = np.cumsum(weights[order]) / weights.sum()
    return float(values[order][np.searchsorted(share, _HELD)] / COVERAGE)


def held(values: NDArray[np.float64], factor: float) -> float:
    """Share of the intervals that hold, per cent."""
    return 100 * float(np.mean(np.abs(values) <= COVERAGE * factor))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('rows', type=Path, nargs='+', metavar='ROWS.json')
    rows = [row for path in parser.parse_args().rows for row in json.loads(path.read_text())]
    print(f'{"held out":12}' + ''.join(f'{name:>32}' for name in SIZES))
    print(f'{"":12}' + f'{"n":>8}{"stated":>8}{"factor":>8}{"held":>8}' * len(SIZES))
    known = {name: ratios_of(rows, name) for name in SIZES}
    largest = dict.fromkeys(SIZES, 0.0)
    for family in dict.fromkeys(row['family'] for row in rows):
        line = f'{family:12}'
        for name in SIZES:
            others = [values for f, values in known[name].items() if f != family]
            if family not in known[name] or not others:
                line += f'{"too few":>32}'
                continue
            own, factor = known[name][family], factor_of(others)
            largest[name] = max(largest[name], factor)
            line += f'{len(own):>8}{held(own, 1):>8.0f}{factor:>8.2f}{held(own, factor):>8.0f}'
        print(line)
    print(f'{"further factor":12}' + ''.join(f'{largest[name]:>30.2f}  ' for name in SIZES))
    print(
        f'{"error / u":12}'
        + ''.join(f'{np.concatenate([*known[name].values()]).std():>30.2f}  ' for name in SIZES)
    )


if __name__ == '__main__':
    main()
