"""A survey as files: pictures of the unrolled skin with their places, points, and a list."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.cloud.ply import write_ply
from ftp_dent_ros.dents.sightings import ListedDent
from ftp_dent_ros.files import write_all_atomically
from ftp_dent_ros.inspection.report import findable_shares
from ftp_dent_ros.pages import drawing
from ftp_dent_ros.pages.page import render
from ftp_dent_ros.pages.words import date_of, finite, interval, position_interval
from ftp_dent_ros.survey.aircraft_frame import AircraftFrame
from ftp_dent_ros.survey.joining import Joining
from ftp_dent_ros.survey.mosaic import PIXEL, Mosaic, by_pixel
from ftp_dent_ros.survey.result import SurveyedDent, SurveyResult
from ftp_dent_ros.survey.unrolled import CELL, Gap

# Depth that the picture of the deviation shows at its ends, metres.
_DEEPEST = 0.5e-3


@dataclass(frozen=True, eq=False)
class Surveyed:
    """A survey with its picture.

    Attributes
    ----------
    result : SurveyResult
    mosaic : Mosaic
    joined : Joining
    """

    result: SurveyResult
    mosaic: Mosaic
    joined: Joining


def write_survey(folder: Path, survey: Surveyed, frame: AircraftFrame | None = None) -> list[Path]:
    """Write pictures, ``mosaic.ply``, ``survey.json`` and the page ``survey.html``.

    The pictures ``skin.png`` and ``deviation.png`` show the unrolled skin from outside, 2 mm a
    pixel; `fields` says where their pixels lie on it. Red is deep and blue is high, 0.5 mm at
    their fullest, and light grey is not known.

    Parameters
    ----------
    folder : Path
    survey : Surveyed
    frame : AircraftFrame, optional
        In which places are given besides.

    Returns
    -------
    list of Path
        What was written.
    """
    mosaic = survey.mosaic
    pictures = {
        'skin': mosaic.image,
        'deviation': drawing.deviation_colours(mosaic.deviation, _DEEPEST)[..., ::-1],
    }
    names = [*(f'{name}.png' for name in pictures), 'mosaic.ply', 'survey.json', 'survey.html']
    with write_all_atomically(folder, names, 'the survey') as temporary:
        for name, picture in pictures.items():
            # y grows upwards on the skin, rows grow downwards.
            _, data = cv2.imencode('.png', picture[::-1])
            temporary[f'{name}.png'].write_bytes(data.tobytes())
        write_ply(temporary['mosaic.ply'], mosaic.cloud(), survey.result.frame_id)
        record = json.dumps(finite(fields(survey, frame)), indent=1)
        temporary['survey.json'].write_text(record, encoding='utf-8')
        page = survey_page(survey, frame)
        temporary['survey.html'].write_text(page, encoding='utf-8', errors='backslashreplace')
    return [folder / name for name in names]


def fields(survey: Surveyed, frame: AircraftFrame | None = None) -> dict[str, Any]:
    """All that is found, as JSON has it: metres but where the name says millimetres."""
    result, mosaic, joined = survey.result, survey.mosaic, survey.joined
    skin, (half, most) = mosaic.skin, findable_shares(mosaic.findable)
    return {
        'name': result.name,
        'sources': list(result.sources),
        'taken_ns': result.taken_ns,
        'frame_id': result.frame_id,
        'software': result.software,
        'rig': result.rig_id,
        'pairs': dict(zip(('used', 'left_out'), joined.pairs, strict=True)),
        'remarks': joined.remarks,
        'poses': [
            {
                'stamp_ns': stamp_ns,
                'position': pose.translation.tolist(),
                'quaternion': pose.quaternion.tolist(),
                'covariance': covariance.ravel().tolist(),
            }
            for stamp_ns, pose, covariance in zip(
                joined.numbers, joined.graph.poses, joined.covariances, strict=True
            )
        ],
        'unrolled': {
            'origin': skin.origin.tolist(),
            'x_axis': skin.axis.tolist(),
            'y_axis': skin.around.tolist(),
            'normal': skin.normal.tolist(),
            'radius': skin.radius,
            'taper': skin.taper,
            # Of the pictures: where the corner of the lowest pixel at the left lies, metres.
            'corner': mosaic.low.tolist(),
            'pixel': PIXEL,
        },
        'dents': [_record(each, survey, frame) for each in result.dents],
        'coverage': {
            'cell_mm': CELL * 1e3,
            'area_m2': mosaic.area,
            'findable_mm': {'median': half * 1e3, 'p95': most * 1e3},
            'gaps': [
                {
                    'unrolled': gap.place.tolist(),
                    'size_mm': (gap.size * 1e3).tolist(),
                    'area_m2': gap.area,
                }
                for gap in mosaic.gaps()[0]
            ],
        },
    }


def _record(each: SurveyedDent, survey: Surveyed, frame: AircraftFrame | None) -> dict[str, Any]:
    dent = each.dent
    record = {
        'number': each.number,
        'kind': dent.kind,
        'position': dent.position.tolist(),
        'unrolled': survey.mosaic.skin.place(dent.position)[:2].tolist(),
        'position_covariance': each.position_covariance.ravel().tolist(),
        'sightings': each.sightings,
        'cut': bool(dent.is_cut),
        'reason': dent.reason,
        **dent.figures(('length_mm', 'width_mm', 'depth_mm')),
    }
    if frame is not None:
        # Station, buttock line and water line, and their standard uncertainties.
        place, spread = frame.place(dent.position)
        record['aircraft_mm'] = (place * 1e3).tolist()
        record['aircraft_uncertainty_mm'] = (np.sqrt(np.diag(spread)) * 1e3).tolist()
    return record


def survey_page(survey: Surveyed, frame: AircraftFrame | None = None) -> str:
    """The whole page as HTML.

    Parameters
    ----------
    survey : Surveyed
    frame : AircraftFrame, optional
        In which places are given besides.
    """
    result = survey.result
    facts = [
        ('Flown', f'{date_of(result.taken_ns)}, {len(survey.joined.numbers)} clouds'),
        ('Joined by', '{} pairs of clouds, {} left out'.format(*survey.joined.pairs)),
        ('Frame', result.frame_id),
        ('Rig', result.rig_id or 'not known'),
    ]
    if frame is not None:
        off = f'{len(frame.residuals)} points, {frame.worst * 1e3:.1f} mm off at most'
        facts.append(('Aircraft', off))
    return render(
        'ftp_dent_ros.survey',
        'survey.html',
        name=result.name,
        sources=result.sources,
        software=result.software,
        headline=f'{result.count} dents, {len(result.dents) - result.count} others',
        skin=skin_of(survey.mosaic, result.dents, facts, survey.joined.remarks),
        dents=result.dents,
        unrolled=survey.mosaic.skin,
        frame=frame,
        interval=interval,
        position_interval=position_interval,
        places=json.dumps(finite(_places(survey))),
    )


def _places(survey: Surveyed) -> dict[str, Any]:
    """What the page needs to tell the place of a pixel."""
    mosaic, skin = survey.mosaic, survey.mosaic.skin
    height = np.where(mosaic.measured(), skin.place(mosaic.cloud().points)[..., 2], np.nan)
    return {
        'name': survey.result.name,
        'pixel': PIXEL,
        'side': CELL,
        'low': mosaic.low.tolist(),
        'rows': height.shape[0],
        'columns': height.shape[1],
        'height': drawing.coded(height),
        'findable': drawing.coded(mosaic.findable),
        'origin': skin.origin.tolist(),
        'axis': skin.axis.tolist(),
        'around': skin.around.tolist(),
        'normal': skin.normal.tolist(),
        'radius': skin.radius,
        'taper': skin.taper,
    }


def skin_of(
    mosaic: Mosaic,
    dents: Iterable[SurveyedDent | ListedDent],
    facts: Sequence[tuple[str, str]] = (),
    remarks: Sequence[str] = (),
) -> dict[str, Any]:
    """The skin as pages show it (``macros.html``); lengths are pixels of the mosaic.

    Parameters
    ----------
    mosaic : Mosaic
    dents : iterable of SurveyedDent or ListedDent
        In the mosaic's frame.
    facts : sequence of (str, str)
        Of the flight, before those of the coverage.
    remarks : sequence of str
        What could not be used, and why.
    """
    rows, columns = mosaic.shape
    gaps, gap_mask = mosaic.gaps()
    # A long strip is shown in parts, each at most four times as long as it is high.
    count = max(1, math.ceil(columns / (4.0 * rows)))
    return {
        'size': (columns, rows),
        'windows': [
            (round(k * columns / count, 2), round(columns / count, 2)) for k in range(count)
        ],
        'layers': _layers(mosaic, gap_mask),
        'outlines': [_outline(each, mosaic) for each in dents],
        'bar': drawing.scale_bar(PIXEL, columns / count),
        'facts': [*facts, *_coverage_facts(gaps, mosaic)],
        'gaps': [
            {
                'x': f'{gap.place[0]:.3f}',
                'y': f'{gap.place[1]:.3f}',
                'width': f'{gap.size[0] * 1e3:.0f}',
                'height': f'{gap.size[1] * 1e3:.0f}',
                'area': f'{gap.area * 1e4:.1f}',
            }
            for gap in gaps[:20]
        ],
        'remarks': list(remarks),
    }


def _layers(mosaic: Mosaic, gap_mask: NDArray[np.bool_]) -> list[dict[str, Any]]:
    picture = np.repeat(mosaic.image[::-1, :, None], 3, axis=-1)
    layers: list[dict[str, Any]] = [
        {
            'title': 'Skin',
            'caption': 'Without the fringes. Black: not measured.',
            'data': drawing.data_uri(drawing.jpeg(picture), 'image/jpeg'),
            'scale': None,
        },
        {
            'title': 'Deviation from the undeformed contour',
            'caption': 'Depth in mm, inward positive (red). Grey: not measured.',
            'data': drawing.png(drawing.deviation_colours(mosaic.deviation[::-1], _DEEPEST)),
            'scale': drawing.depth_scale(_DEEPEST),
        },
    ]
    findable = mosaic.findable.astype(float) * 1e3
    known = findable[np.isfinite(findable)]
    if not len(known):
        return layers
    low, high = np.percentile(known, [1, 99])
    high = max(high, 1.01 * low)
    pixels = drawing.coloured(np.log(findable), np.log(low), np.log(high), 'viridis_r')
    pixels[gap_mask] = (216, 35, 42)
    layers.append(
        {
            'title': 'Smallest dent that would have been found',
            'caption': f'Depth in mm, in each cell of {CELL * 1e3:.0f} mm, of a dent of the '
            'smallest width. Grey: not measured; red: a gap.',
            'data': drawing.png(by_pixel(pixels)[::-1]),
            'scale': {
                'data': drawing.png(drawing.colours('viridis_r')[None]),
                'marks': [f'{low * (high / low) ** part:.3g}' for part in np.linspace(0, 1, 5)],
            },
        }
    )
    return layers


def _coverage_facts(gaps: Sequence[Gap], mosaic: Mosaic) -> list[tuple[str, str]]:
    area, missing = mosaic.area, sum(gap.area for gap in gaps)
    share = area / (area + missing) if area else 0.0
    largest = ', the largest {:.0f} x {:.0f} mm'.format(*(gaps[0].size * 1e3)) if gaps else ''
    facts = [
        ('Measured', f'{area:.3f} m², {100 * share:.2f} % of the skin without its rim'),
        ('Gaps', f'{len(gaps)}{largest}'),
    ]
    half, most = (1e3 * share for share in findable_shares(mosaic.findable))
    if math.isfinite(most):
        text = f'{half:.3f} mm deep on half of it, {most:.3f} mm on 95 %'
        facts.append(('A dent was found from', text))
    return facts


def _outline(entry: SurveyedDent | ListedDent, mosaic: Mosaic) -> dict[str, Any]:
    dent = entry.dent
    place = (mosaic.skin.place(dent.closed_outline)[:, :2] - mosaic.low) / PIXEL
    u, v = place[:, 0], mosaic.shape[0] - place[:, 1]
    return {
        'points': ' '.join(f'{a:.1f},{b:.1f}' for a, b in zip(u, v, strict=True)),
        'number': entry.number,
        'kind': dent.kind,
        'left': round(float(u.min()), 1),
        'right': round(float(u.max()), 1),
        'top': round(float(v.min()), 1),
    }
