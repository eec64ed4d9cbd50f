"""The study as tables, pictures and a page."""

from __future__ import annotations

import base64
import io
import math
import platform
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jinja2
import matplotlib
import numpy as np
import scipy.fft
from matplotlib.figure import Figure

from ftp_dent_ros import __version__
from ftp_dent_ros.evaluation.scenes import PATTERN, Scene
from ftp_dent_ros.evaluation.study import (
    ESTRADA,
    ITOH,
    LEAST_SQUARES,
    SMOOTHER,
    Entry,
    Method,
    Study,
)
from ftp_dent_ros.files import written_aside
from ftp_dent_ros.profilometry.carrier import ReferencePlane, carrier_on
from ftp_dent_ros.profilometry.fourier_transform.reference import reference_phase

_COLUMNS = ('', 'method', 'MAE (std), mm', 'paper, mm', 'dent MAE', 'depth bias', 'coverage', 'ms')

_MM = 1e3
_NOTHING = '0.85'


@dataclass(frozen=True)
class Table:
    """A table of the page."""

    title: str
    remark: str
    rows: list[tuple[str, ...]]
    columns: tuple[str, ...] = _COLUMNS


def tables_of(study: Study) -> list[Table]:
    """All tables of the page."""
    section = (*ITOH, *ESTRADA, *SMOOTHER, LEAST_SQUARES)
    photographs = 'noise of 12,000 electrons at saturation, 0.8 grey levels of read noise, 8 bits'
    return [
        _table(
            study,
            'Section 3: dent of 3 mm x 30 mm at 1 m',
            'White noise of 0.6 rad, added to the phase map (as in the paper), or put into the '
            'light of each pixel before it is photographed, or none. Where a photograph was '
            'refused, the figures are of the others.',
            'section 3',
            section,
        ),
        _table(
            study,
            "Table 3: samples at 60 cm, Itoh's unwrapping",
            f'Photographs with {photographs}.',
            'static',
            (*ITOH, LEAST_SQUARES),
        ),
        _table(
            study,
            "Table 4: samples at 60 cm, Estrada's unwrapping",
            f'Photographs with {photographs}.',
            'static',
            (*ESTRADA, LEAST_SQUARES),
        ),
        _table(
            study,
            "Table 6: samples at 120 cm, Estrada's unwrapping",
            f'Moving at 0.1 m/s, exposed for 10 ms, and still; photographs with {photographs}.',
            'dynamic',
            (*ESTRADA, LEAST_SQUARES),
        ),
        _times(study),
    ]


def _table(
    study: Study, title: str, remark: str, table: str, methods: tuple[Method, ...]
) -> Table:
    rows = []
    for row, entries in study.of(table).items():
        label = row
        for entry in entries:
            if entry.method not in methods:
                continue
            rows.append((label, *_cells(entry)))
            label = ''
    return Table(title, remark, rows)


def _cells(entry: Entry) -> tuple[str, ...]:
    figures, paper = entry.figures, entry.paper
    said = f'{paper[0]:.3f} ({paper[1]:.3f})' if paper else ''
    if entry.refused == entry.case.seeds:
        return entry.method.name, f'refused {entry.refused} of {entry.refused}', said, *[''] * 4
    refused = f', refused {entry.refused} of {entry.case.seeds}' if entry.refused else ''
    return (
        entry.method.name,
        f'{figures.mae:.4f} ({figures.deviation:.4f}){refused}',
        said,
        _number(figures.dent_mae, '.4f'),
        _number(figures.depth_bias, '+.4f'),
        f'{100 * figures.coverage:.1f} %',
        _number(1e3 * figures.seconds, '.0f'),
    )


def _number(value: float, form: str) -> str:
    return '' if math.isnan(value) else format(value, form)


def _times(study: Study) -> Table:
    """Running times; the paper's are of its Python implementation (section 3)."""
    paper = {ITOH[0].name: '360', ITOH[1].name: '1180'}
    sizes = {'1280x720': ('section 3', 'none'), '1920x1080': ('static', 'A')}
    rows = []
    for method in (*ITOH, *ESTRADA, LEAST_SQUARES):
        times = [
            _number(1e3 * study.one(table, row, method).figures.seconds, '.0f')
            for table, row in sizes.values()
        ]
        rows.append((method.name, *times, paper.get(method.name, '')))
    columns = 'method', *(f'{size}, ms' for size in sizes), 'paper, 1280x720, ms'
    return Table('Running time, one photograph, tables warm', '', rows, columns)


def error_maps(entries: Sequence[Entry]) -> bytes:
    """Absolute errors of methods side by side, each to its own scale (figures 12, 13, 16, 17)."""
    figure = Figure(figsize=(4.2 * len(entries), 3.0), layout='constrained')
    for axes, entry in zip(_row(figure, len(entries)), entries, strict=True):
        axes.set_title(entry.method.name, fontsize=9)
        axes.set_axis_off()
        error = entry.first.error_mm
        if error is None:
            axes.text(0.5, 0.5, 'refused: no fringe order\nthat the stripe agrees on', ha='center')
            continue
        error = np.abs(_cropped(error))
        colours = matplotlib.colormaps['viridis'].copy()
        colours.set_bad(_NOTHING)
        limit = float(np.nanpercentile(error, 99))
        image = axes.imshow(error, cmap=colours, vmin=0, vmax=limit, interpolation='nearest')
        scale = figure.colorbar(image, ax=axes, shrink=0.85)
        scale.set_label(f'mm; MAE {np.nanmean(error):.3g}', fontsize=8)
        scale.ax.tick_params(labelsize=7)
    return _png(figure)


def sections(entries: Sequence[Entry]) -> bytes:
    """Depth and its error along the row through the dent's middle (figure 15)."""
    figure = Figure(figsize=(4.2 * len(entries), 4.2), layout='constrained')
    upper, lower = figure.subplots(2, len(entries), sharex=True, squeeze=False)
    limit = 0.0
    for above, below, entry in zip(upper, lower, entries, strict=True):
        above.set_title(entry.method.name, fontsize=9)
        cloud, error = entry.first.cloud, entry.first.error_mm
        if cloud is None or error is None:
            continue
        along, across = entry.case.scene.on_panel(cloud.points)
        points = cloud.valid.sum(axis=1)
        off = np.where(cloud.valid, np.abs(across), 0).sum(axis=1) / np.maximum(points, 1)
        row = np.where(points > 0, off, np.inf).argmin()
        x = along[row] * _MM
        local = entry.case.scene.panel.pose.inverse().apply(cloud.points[row].astype(float))
        depth = local[:, 2] * _MM
        truth, _, _ = entry.case.scene.dent.height(local[:, 0], local[:, 1])
        above.plot(x, -depth, linewidth=1.0, label='measured')
        above.plot(x, -_MM * truth, 'k--', linewidth=0.8, label='truth')
        below.plot(x, error[row], linewidth=0.6)
        below.set_xlabel('along the panel, mm', fontsize=8)
        limit = max(limit, float(np.nanpercentile(np.abs(error[row]), 99.5)))
    if limit:
        for below in lower:
            below.set_ylim(-1.2 * limit, 1.2 * limit)
        upper[0].legend(fontsize=8)
    upper[0].set_ylabel('height, mm', fontsize=8)
    lower[0].set_ylabel('error, mm', fontsize=8)
    return _png(figure)


def spectrum(scene: Scene) -> bytes:
    """Spectra of the middle row, of the object and of the virtual reference (figure 3)."""
    red = scene.photograph(0)[..., 0].astype(float)
    plane = ReferencePlane(float(scene.panel.pose.translation[2]))
    carrier = carrier_on(scene.rig, PATTERN, plane)
    middle = red.shape[0] // 2
    lit = np.flatnonzero(scene.lit()[middle] & (red[middle] > 0))
    columns = slice(lit[0], lit[-1] + 1)
    rays = scene.rig.camera.rays(scene.rig.camera.pixel_grid())[middle, columns]
    reference = 0.5 + 0.5 * np.cos(reference_phase(scene.rig, PATTERN, rays[None], plane))[0]
    reference *= red[middle, columns].mean() / reference.mean()
    figure = Figure(figsize=(7, 3), layout='constrained')
    axes = figure.add_subplot()
    for values, style, label in (
        (red[middle, columns], 'b-', 'object'),
        (reference, 'r:', 'virtual reference'),
    ):
        frequency = scipy.fft.rfftfreq(len(values))
        axes.semilogy(frequency, np.abs(scipy.fft.rfft(values)), style, linewidth=0.8, label=label)
    axes.axvline(carrier.frequency, color='k', linewidth=0.8, label='carrier and band')
    for side in (-1, 1):
        axes.axvline(carrier.frequency + side * carrier.radius, color='k', ls=':', linewidth=0.8)
    axes.set(xlabel='cycles a pixel', ylabel='modulus', xlim=(0, 3 * carrier.frequency))
    axes.legend(fontsize=8)
    return _png(figure)


def _row(figure: Figure, count: int) -> Sequence[Any]:
    return figure.subplots(1, count, squeeze=False)[0]


def _cropped(error):
    """The part of the image that holds points."""
    rows, columns = (np.flatnonzero(np.isfinite(error).any(axis=axis)) for axis in (1, 0))
    return error[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]


def _png(figure: Figure) -> bytes:
    stream = io.BytesIO()
    figure.savefig(stream, format='png', dpi=110)
    return stream.getvalue()


@dataclass(frozen=True)
class Picture:
    """A picture of the page."""

    name: str
    caption: str
    png: bytes

    @property
    def data(self) -> str:
        """For an ``img`` element."""
        return 'data:image/png;base64,' + base64.b64encode(self.png).decode()


def write_pages(folder: Path, study: Study) -> tuple[Path, Path]:
    """Write ``index.html``, ``evaluation.md`` and the pictures; return the two pages' paths."""
    folder.mkdir(parents=True, exist_ok=True)
    tables, drawn = tables_of(study), _pictures(study)
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader('ftp_dent_ros.evaluation', 'templates'),
        autoescape=jinja2.select_autoescape(['html.j2']),
        trim_blocks=True,
        lstrip_blocks=True,
    )
    values = {
        'tables': tables,
        'pictures': drawn,
        'claims': claims(study),
        'quick': study.quick,
        'version': __version__,
        'machine': f'{platform.system()} {platform.machine()}, Python {platform.python_version()}',
    }
    for picture in drawn:
        with written_aside(folder / f'{picture.name}.png') as aside:
            aside.write_bytes(picture.png)
    pages = folder / 'index.html', folder / 'evaluation.md'
    for page, template in zip(pages, ('page.html.j2', 'page.md.j2'), strict=True):
        with written_aside(page) as aside:
            text = environment.get_template(template).render(values)
            aside.write_text(text, encoding='utf-8')
    return pages


def claims(study: Study) -> list[tuple[str, str]]:
    """What the paper claims, and whether it came out."""
    found = []
    for unwrapping, pair in (("Itoh's", ITOH), ("Estrada's", ESTRADA)):
        noisy = [study.one('section 3', 'phase map', method) for method in pair]
        found.append(
            (
                f'Under noise on the phase map the virtual reference is better than the direct '
                f'mapping, with {unwrapping} unwrapping (section 3).',
                _better(*noisy),
            )
        )
        gains = [
            1 - study.one('static', row, pair[1]).figures.mae / direct.figures.mae
            for row in study.of('static')
            for direct in [study.one('static', row, pair[0])]
        ]
        found.append(
            (
                f'On photographs of the samples it is better by 9 to 55 %, with {unwrapping} '
                'unwrapping (tables 3 and 4).',
                f'by {100 * min(gains):.1f} to {100 * max(gains):.1f} %',
            )
        )
    moving = [
        study.one('dynamic', f'{name}, dynamic', ESTRADA[1]).figures.mae
        / study.one('dynamic', f'{name}, static', ESTRADA[1]).figures.mae
        for name in 'ABCD'
    ]
    found.append(
        (
            'Movement at 0.1 m/s costs no accuracy (table 6).',
            f'it costs {100 * (min(moving) - 1):.0f} to {100 * (max(moving) - 1):.0f} %',
        )
    )
    return found


def _better(direct: Entry, virtual: Entry) -> str:
    if virtual.refused == virtual.case.seeds:
        return 'not so: both were refused' if direct.refused == direct.case.seeds else 'not so'
    if direct.refused:
        return (
            f'so: the direct mapping was refused {direct.refused} times of {direct.case.seeds}, '
            f'the virtual reference {virtual.refused} times'
        )
    ratio = direct.figures.mae / virtual.figures.mae
    return f'so, by a factor of {ratio:.2f}' if ratio > 1 else f'not so: {1 / ratio:.2f} times'


def _pictures(study: Study) -> list[Picture]:
    noisy, still, moving = ('section 3', 'phase map'), ('static', 'C'), ('dynamic', 'C, dynamic')

    def of(case: tuple[str, str], methods: tuple[Method, ...]) -> list[Entry]:
        return [study.one(*case, method) for method in (*methods, LEAST_SQUARES)]

    estrada = "Estrada's unwrapping, tau 0.8"
    sample_a = study.one('static', 'A', ITOH[0]).case.scene
    return [
        Picture(
            'figure3',
            'As figure 3: sample A, middle row, with the automatic band.',
            spectrum(sample_a),
        ),
        Picture(
            'figure12',
            "As figure 12: section 3, Itoh's unwrapping.",
            error_maps(of(noisy, ITOH)),
        ),
        Picture(
            'figure13',
            f'As figure 13: section 3, {estrada}.',
            error_maps(of(noisy, ESTRADA)),
        ),
        Picture(
            'figure15',
            "As figure 15: sample A, the middle row, Itoh's unwrapping.",
            sections(of(('static', 'A'), ITOH)),
        ),
        Picture(
            'figure16',
            f'As figure 16: sample C at 60 cm, {estrada}.',
            error_maps(of(still, ESTRADA)),
        ),
        Picture(
            'figure17',
            f'As figure 17: sample C at 120 cm, moving, {estrada}.',
            error_maps(of(moving, ESTRADA)),
        ),
    ]
