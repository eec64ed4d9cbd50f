"""What each kind must keep, and the lines that say what it does not."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from kind_figures import DentFigures, Figures

# Edges and marks across dents, where a depth may also be told as not measured.
ACROSS = 'sun_edge', 'sun_edge_soft', 'paint_edge', 'lettering', 'patches', 'scratches'
DIRT = 'dirt', 'streaks', 'hail'
# Shallower hail need not be found, and shallower dents need not be whole, millimetres.
HAIL, WHOLE = 0.15, 0.25


def verdict(name: str, results: list[Figures], of_kind: list[Figures]) -> list[str]:
    """Lines on what one method's photographs of a kind do not keep; none if all is well."""
    return list(_lines(name, results, of_kind))


def _lines(name: str, results: list[Figures], of_kind: list[Figures]) -> Iterator[str]:
    for r in results:
        where = f'seed {r.seed}: '
        if r.crashed:
            yield f'{where}CRASH {r.crashed}'
        elif r.refused:
            yield f'{where}refused: {r.refused}'
    measured = [r for r in results if not (r.crashed or r.refused)]
    for r in measured:
        where = f'seed {r.seed}: '
        if not math.isnan(r.spread):
            yield from _normalised(where, '', r.spread, r.below4)
            if r.edge_count > 500:
                yield from _normalised(where, 'edges: ', r.edge_spread, r.edge_below4)
        for text in (*r.false_dents, *r.false_bumps):
            yield f'{where}false {text}'
        for dent in r.dents:
            for line in _dent(name, dent):
                yield f'{where}{dent.kind} {dent.depth:.2f} x {dent.width:.0f} mm: {line}'
        other = [v for v in of_kind if v.method == 'virtual-reference' and v.seed == r.seed]
        if other and r.method != 'virtual-reference' and other[0].mae < 0.95 * r.mae:
            yield f'{where}MAE {r.mae:.4f}, virtual-reference {other[0].mae:.4f}'
        if other and r.method == 'default':
            for dent, theirs in zip(r.dents, other[0].dents, strict=False):
                less = abs(dent.cloud_error) - abs(theirs.cloud_error)
                if less > 2 * dent.cloud_sigma and dent.depth * dent.cloud_error < 0:
                    yield f'{where}{less:.3f} mm less of a dent than virtual-reference has'


def _normalised(where: str, part: str, spread: float, below4: float) -> Iterator[str]:
    if not 0.7 <= spread <= 1.4:
        yield f'{where}{part}error/sigma has a spread of {spread:.2f}'
    if below4 < 0.99:
        yield f'{where}{part}error/sigma is below 4 in {100 * below4:.1f} %'


def _dent(name: str, dent: DentFigures) -> Iterator[str]:
    """One true dent."""
    depth = abs(dent.depth)
    measured = math.isfinite(dent.cloud_error)
    flattened = -dent.cloud_error if dent.depth > 0 else dent.cloud_error
    sigma = dent.cloud_sigma if math.isfinite(dent.cloud_sigma) else 0.0
    if measured and depth >= WHOLE and sigma and flattened > 2 * sigma:
        yield f'cloud {flattened:.3f} mm too shallow, {flattened / sigma:.1f} u'
    if name == 'narrow_dents' and abs(dent.cloud_error) > max(0.03 * depth, 2 * sigma):
        yield f'cloud off by {dent.cloud_error:+.3f} mm at its centre'
    if name in ACROSS and dent.found and abs(dent.depth_error) > 0.03:
        yield f'depth {dent.depth_error:+.3f} mm'
    if name.startswith(DIRT):
        if depth >= HAIL and not dent.found:
            yield 'not found'
        if dent.found and abs(dent.depth_error) > max(0.02, 0.1 * depth):
            yield f'depth {dent.depth_error:+.3f} mm'
    for what, error, u in (
        ('depth', dent.depth_error, dent.depth_u),
        ('length', dent.length_error, dent.length_u),
        ('width', dent.width_error, dent.width_u),
    ):
        if dent.found and np.isfinite(error) and abs(error) > 3 * u:
            yield f'{what} {error:+.3f} mm, {error / u:+.1f} u'
