"""What a survey shows: pictures of the unrolled skin with its dents, and what was looked at."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

import cv2
import matplotlib
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.inspection.reporting import drawing
from ftp_dent_ros.inspection.reporting.skin import Layer, Skin
from ftp_dent_ros.survey.result import CoverageCells, SurveyedDent
from ftp_dent_ros.survey.skin_map.mosaic import PIXEL, Mosaic

_MM = 1e3
_SCALE_BARS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0)
# Depth at the ends of the deviation's colours, metres.
_DEEPEST = 0.5e-3
_GAPS, _REMARKS = 20, 12
# Of a part that is shown side by side: length by height.
_LONGEST = 4.0
_NOTHING, _GAP = (225, 227, 230), (216, 35, 42)
_COLOURS = 'viridis_r'


def skin_of(
    mosaic: Mosaic,
    dents: Iterable[SurveyedDent],
    facts: Sequence[tuple[str, str]] = (),
    remarks: Sequence[str] = (),
) -> Skin:
    """The skin as it is shown.

    Parameters
    ----------
    mosaic : Mosaic
    dents : iterable of SurveyedDent
        In the mosaic's frame.
    facts : sequence of (str, str)
        Of the flight, before those of the coverage.
    remarks : sequence of str
        What could not be used, and why.
    """
    rows, columns = mosaic.shape
    cells = mosaic.coverage()
    told = [*remarks[:_REMARKS]]
    if len(remarks) > _REMARKS:
        told.append(f'And {len(remarks) - _REMARKS} more remarks.')
    return Skin(
        size=(int(columns), int(rows)),
        windows=_windows(columns, rows),
        layers=_layers(mosaic, cells),
        outlines=[_outline(each, mosaic) for each in dents],
        bar=_bar(_windows(columns, rows)[0][1]),
        facts=[*facts, *_coverage_facts(mosaic, cells)],
        gaps=[
            {
                'x': f'{gap.place[0]:.3f}',
                'y': f'{gap.place[1]:.3f}',
                'width': f'{gap.size[0] * _MM:.0f}',
                'height': f'{gap.size[1] * _MM:.0f}',
                'area': f'{gap.area * 1e4:.1f}',
            }
            for gap in mosaic.gaps()[:_GAPS]
        ],
        remarks=told,
    )


def by_cell(mosaic: Mosaic, cells: CoverageCells, values: NDArray) -> NDArray[np.float64]:
    """Values of the measured cells on the mosaic's grid of cells, NaN elsewhere."""
    side = cells.size
    rows, columns = (round(size * PIXEL / side) for size in mosaic.shape)
    grid = np.full((rows, columns), np.nan)
    column, row = np.floor(
        (mosaic.skin.place(cells.positions.astype(float))[:, :2] - mosaic.low) / side
    ).T.astype(int)
    grid[np.clip(row, 0, rows - 1), np.clip(column, 0, columns - 1)] = values
    return grid


def _layers(mosaic: Mosaic, cells: CoverageCells) -> list[Layer]:
    picture = np.repeat(mosaic.image[::-1, :, None], 3, axis=-1)
    layers = [Layer('Skin', 'Without the fringes. Black: not measured.', _jpeg(picture))]
    marks = [f'{value:+.3g}' if value else '0' for value in np.linspace(-1, 1, 5) * _DEEPEST * _MM]
    layers.append(
        Layer(
            'Deviation from the undeformed contour',
            'Depth in mm, inward positive (red). Grey: not measured.',
            drawing.heat_map(mosaic.deviation[::-1], _DEEPEST),
            drawing.png(drawing.colour_table()[None]),
            marks,
        )
    )
    findable = by_cell(mosaic, cells, cells.findable) * _MM
    known = findable[np.isfinite(findable)]
    if len(known):
        low, high = np.percentile(known, [1, 99])
        high = max(high, 1.01 * low)
        table = np.round(255 * matplotlib.colormaps[_COLOURS](np.linspace(0, 1, 256))[:, :3])
        share = np.log(np.clip(findable, low, high) / low) / np.log(high / low)
        pixels = table[np.nan_to_num(255 * share).astype(int)].astype(np.uint8)
        pixels[~np.isfinite(findable)] = _NOTHING
        for gap in mosaic.gaps():
            pixels[tuple(gap.cells.T)] = _GAP
        size = (int(mosaic.shape[1]), int(mosaic.shape[0]))
        pixels = cv2.resize(pixels, size, interpolation=cv2.INTER_NEAREST)
        marks = [f'{low * (high / low) ** part:.3g}' for part in np.linspace(0, 1, 5)]
        layers.append(
            Layer(
                'Smallest dent that would have been found',
                f'Depth in mm, in each cell of {cells.size * _MM:.0f} mm, of a dent of the '
                'smallest width. Grey: not measured; red: a gap.',
                drawing.png(pixels[::-1]),
                drawing.png(table.astype(np.uint8)[None]),
                marks,
            )
        )
    return layers


def _coverage_facts(mosaic: Mosaic, cells: CoverageCells) -> list[tuple[str, str]]:
    gaps = mosaic.gaps()
    area = len(cells.views) * cells.size**2
    missing = sum(gap.area for gap in gaps)
    share = area / (area + missing) if area else 0.0
    largest = ''
    if gaps:
        largest = ', the largest {:.0f} x {:.0f} mm'.format(*(gaps[0].size * _MM))
    facts = [
        ('Measured', f'{area:.3f} m², {100 * share:.2f} % of the skin without its rim'),
        ('Gaps', f'{len(gaps)}{largest}'),
    ]
    known = cells.findable[np.isfinite(cells.findable)] * _MM
    if len(known):
        half, most = np.percentile(known, [50, 95])
        text = f'{half:.3f} mm deep on half of it, {most:.3f} mm on 95 %'
        facts.append(('A dent was found from', text))
    if len(cells.views):
        once, often = float(np.mean(cells.views == 1)), np.median(cells.views)
        text = f'{often:.0f} times or more on half of it, ' if often > 1 else ''
        facts.append(('Places seen', f'{text}once on {100 * once:.0f} %'))
    return facts


def _outline(entry: SurveyedDent, mosaic: Mosaic) -> dict[str, Any]:
    dent = entry.dent
    points = dent.outline if len(dent.outline) else dent.position[None]
    place = (mosaic.skin.place(points)[:, :2] - mosaic.low) / PIXEL
    u, v = place[:, 0], mosaic.shape[0] - place[:, 1]
    return {
        'points': ' '.join(f'{a:.1f},{b:.1f}' for a, b in zip(u, v, strict=True)),
        'number': entry.number,
        'kind': dent.kind,
        'left': round(float(u.min()), 1),
        'right': round(float(u.max()), 1),
        'top': round(float(v.min()), 1),
    }


def _windows(columns: int, rows: int) -> list[tuple[float, float]]:
    """Parts of a long strip that are not too low to be looked at."""
    count = max(1, math.ceil(columns / (_LONGEST * rows)))
    width = columns / count
    return [(round(index * width, 2), round(width, 2)) for index in range(count)]


def _bar(columns: float) -> dict[str, Any]:
    goal = columns * PIXEL / 7
    length = min(_SCALE_BARS, key=lambda bar: abs(math.log(bar / goal)))
    text = f'{length:g} m' if length >= 1 else f'{length * _MM:g} mm'
    return {'length': length / PIXEL, 'text': text}


def _jpeg(pixels: NDArray[np.uint8]) -> str:
    return drawing.data_uri(drawing.jpeg(pixels), 'image/jpeg')
