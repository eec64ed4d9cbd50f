"""The study as tables and pictures on one page."""

from __future__ import annotations

import math
import platform
from collections.abc import Sequence
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from ftp_dent_ros import __version__
from ftp_dent_ros.evaluation.study import ESTRADA, ITOH, LEAST_SQUARES, SMOOTHER, Entry
from ftp_dent_ros.files import write_texts
from ftp_dent_ros.pages.drawing import data_uri, figure_png
from ftp_dent_ros.pages.page import render

_SENSOR = 'noise of 12,000 electrons at saturation, 0.8 grey levels of read noise, 8 bits'
# Title, remark, table of the study, methods.
_TABLES = (
    (
        'Section 3: dent of 3 mm x 30 mm at 1 m',
        'White noise of 0.6 rad, added to the phase map (as in the paper), or put into the light '
        'of each pixel before it is photographed, or none. Where a photograph was refused, the '
        'figures are of the others.',
        'section 3',
        ITOH | ESTRADA | SMOOTHER | LEAST_SQUARES,
    ),
    (
        "Table 3: samples at 60 cm, Itoh's unwrapping",
        f'Photographs with {_SENSOR}.',
        'static',
        ITOH | LEAST_SQUARES,
    ),
    (
        "Table 4: samples at 60 cm, Estrada's unwrapping",
        f'Photographs with {_SENSOR}.',
        'static',
        ESTRADA | LEAST_SQUARES,
    ),
    (
        "Table 6: samples at 120 cm, Estrada's unwrapping",
        f'Moving at 0.1 m/s, exposed for 10 ms, and still; photographs with {_SENSOR}.',
        'dynamic',
        ESTRADA | LEAST_SQUARES,
    ),
)
# Captions, and table, row and methods of what is drawn.
_PICTURES = (
    ("As figure 12: section 3, Itoh's unwrapping.", 'section 3', 'phase map', ITOH),
    ("As figure 13: section 3, Estrada's unwrapping.", 'section 3', 'phase map', ESTRADA),
    ('As figure 16: sample C at 60 cm.', 'static', 'C', ESTRADA | LEAST_SQUARES),
    (
        'As figure 17: sample C at 120 cm, moving.',
        'dynamic',
        'C, dynamic',
        ESTRADA | LEAST_SQUARES,
    ),
)
COLUMNS = ('', 'method', 'MAE (std), mm', 'paper, mm', 'dent MAE', 'depth bias', 'coverage', 'ms')


def write_page(folder: Path, entries: Sequence[Entry], quick: bool) -> Path:
    """Write ``index.html``; return its path."""
    tables = [
        (
            title,
            remark,
            [_cells(e) for e in entries if e.case.table == table and e.method in methods],
        )
        for title, remark, table, methods in _TABLES
    ]
    pictures = [
        (
            caption,
            error_maps(
                [
                    e
                    for e in entries
                    if (e.case.table, e.case.row) == (table, row) and e.method in methods
                ]
            ),
        )
        for caption, table, row, methods in _PICTURES
    ]
    text = render(
        'ftp_dent_ros.evaluation',
        'templates/page.html.j2',
        columns=COLUMNS,
        tables=tables,
        pictures=pictures,
        quick=quick,
        version=__version__,
        machine=f'{platform.system()} {platform.machine()}',
    )
    write_texts(folder, {'index.html': text}, 'the page')
    return folder / 'index.html'


def _cells(entry: Entry) -> tuple[str, ...]:
    figures, paper, seeds = entry.figures, entry.paper, entry.case.seeds
    said = f'{paper[0]:.3f} ({paper[1]:.3f})' if paper else ''
    mae = f'{figures.mae:.4f} ({figures.deviation:.4f})' if entry.refused < seeds else ''
    return (
        entry.case.row,
        entry.method,
        mae + (f' refused {entry.refused} of {seeds}' if entry.refused else ''),
        said,
        *(
            '' if math.isnan(value) else format(value, form)
            for value, form in (
                (figures.dent_mae, '.4f'),
                (figures.depth_bias, '+.4f'),
                (figures.coverage, '.1%'),
                (1e3 * figures.seconds, '.0f'),
            )
        ),
    )


def error_maps(entries: Sequence[Entry]) -> str:
    """Absolute errors of methods side by side, each to its own scale (figures 12, 13, 16, 17)."""
    figure = Figure(figsize=(4.2 * len(entries), 3.0), layout='constrained')
    for axes, entry in zip(
        figure.subplots(1, len(entries), squeeze=False)[0], entries, strict=True
    ):
        axes.set_title(entry.method, fontsize=9)
        axes.set_axis_off()
        error = entry.error_mm
        if error is None:
            axes.text(0.5, 0.5, 'refused: no fringe order\nthat the stripe agrees on', ha='center')
            continue
        error = np.abs(_cropped(error))
        colours = matplotlib.colormaps['viridis'].copy()
        colours.set_bad('0.85')
        limit = float(np.nanpercentile(error, 99))
        image = axes.imshow(error, cmap=colours, vmin=0, vmax=limit, interpolation='nearest')
        scale = figure.colorbar(image, ax=axes, shrink=0.85)
        scale.set_label(f'mm; MAE {np.nanmean(error):.3g}', fontsize=8)
        scale.ax.tick_params(labelsize=7)
    return data_uri(figure_png(figure))


def _cropped(error):
    """The part of the image that holds points."""
    rows, columns = (np.flatnonzero(np.isfinite(error).any(axis=axis)) for axis in (1, 0))
    return error[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
