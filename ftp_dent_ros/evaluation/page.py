"""The evaluation as a page, in HTML (one file, opens offline) and in Markdown."""

from __future__ import annotations

import base64
import platform
from dataclasses import dataclass
from pathlib import Path

import jinja2

from ftp_dent_ros import __version__
from ftp_dent_ros.evaluation import pictures
from ftp_dent_ros.evaluation.study import ESTRADA, ITOH, Entry, Study
from ftp_dent_ros.evaluation.tables import tables_of
from ftp_dent_ros.evaluation.trial import LEAST_SQUARES, Method
from ftp_dent_ros.files import written_aside


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
            pictures.spectrum(sample_a),
        ),
        Picture(
            'figure12',
            "As figure 12: section 3, Itoh's unwrapping.",
            pictures.error_maps(of(noisy, ITOH)),
        ),
        Picture(
            'figure13',
            f'As figure 13: section 3, {estrada}.',
            pictures.error_maps(of(noisy, ESTRADA)),
        ),
        Picture(
            'figure15',
            "As figure 15: sample A, the middle row, Itoh's unwrapping.",
            pictures.sections(of(('static', 'A'), ITOH)),
        ),
        Picture(
            'figure16',
            f'As figure 16: sample C at 60 cm, {estrada}.',
            pictures.error_maps(of(still, ESTRADA)),
        ),
        Picture(
            'figure17',
            f'As figure 17: sample C at 120 cm, moving, {estrada}.',
            pictures.error_maps(of(moving, ESTRADA)),
        ),
    ]
