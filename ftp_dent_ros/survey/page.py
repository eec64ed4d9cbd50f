"""A survey as a page that people read and pick points in: one file, without any other."""

from __future__ import annotations

import base64
import json
from importlib import resources
from typing import Any

import numpy as np
from jinja2 import Environment, FunctionLoader, StrictUndefined
from numpy.typing import NDArray

from ftp_dent_ros.inspection.reporting.figures import interval
from ftp_dent_ros.survey.aircraft_frame import AircraftFrame
from ftp_dent_ros.survey.comparing.chart import date_of
from ftp_dent_ros.survey.evidence import by_cell, skin_of
from ftp_dent_ros.survey.result import SurveyedDent
from ftp_dent_ros.survey.skin_map.mosaic import PIXEL
from ftp_dent_ros.survey.surveying import Surveyed

_MM = 1e3
# Of the heights in the page, metres, and the number of one that is not known.
_STEP, _UNKNOWN = 1e-5, -32768


def survey_page(survey: Surveyed, frame: AircraftFrame | None = None) -> str:
    """The whole page as HTML.

    Parameters
    ----------
    survey : Surveyed
    frame : AircraftFrame, optional
        In which places are given besides.
    """
    result = survey.result
    ours, theirs = (
        resources.files(f'ftp_dent_ros.{room}') for room in ('survey', 'inspection.reporting')
    )
    environment = Environment(
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        loader=FunctionLoader(lambda name: theirs.joinpath(name).read_text('utf-8')),
    )
    dents = [each for each in result.dents if each.dent.kind == 'dent']
    used = survey.pairs - survey.left_out
    facts = [
        ('Flown', f'{date_of(result.taken_ns)}, {len(result.stamps_ns)} clouds'),
        ('Joined by', f'{used} pairs of clouds, {survey.left_out} left out'),
        ('Frame', result.frame_id),
        ('Rig', result.rig_id or 'not told'),
    ]
    if frame is not None:
        off = float(np.linalg.norm(frame.residuals, axis=1).max()) * _MM
        facts.append(('Aircraft', f'{len(frame.points)} points, {off:.1f} mm off at most'))
    return environment.from_string(ours.joinpath('survey.html').read_text('utf-8')).render(
        style=theirs.joinpath('page.css').read_text('utf-8'),
        script=ours.joinpath('picking.js').read_text('utf-8'),
        name=result.name,
        sources=result.sources,
        software=result.software,
        headline=f'{len(dents)} dents, {len(result.dents) - len(dents)} others',
        skin=skin_of(survey.mosaic, result.dents, facts, survey.remarks),
        dents=[_dent(each, survey, frame) for each in result.dents],
        frame=frame,
        places=json.dumps(_places(survey)),
    )


def _dent(each: SurveyedDent, survey: Surveyed, frame: AircraftFrame | None) -> dict[str, Any]:
    dent = each.dent
    told: dict[str, Any] = {
        'number': each.number,
        'kind': dent.kind,
        'cut': dent.is_cut,
        'reason': dent.reason,
        'sightings': each.sightings,
        'unrolled': ', '.join(f'{v:.3f}' for v in survey.mosaic.skin.place(dent.position)[:2]),
        'position': ', '.join(f'{value:.3f}' for value in dent.position),
        'spread': f'{np.sqrt(np.trace(each.position_covariance) / 3) * _MM:.1f}',
        **{name: interval(getattr(dent, name)) for name in ('depth', 'length', 'width')},
    }
    if frame is not None:
        place, spread = frame.place(dent.position)
        told['aircraft'] = ', '.join(f'{value * _MM:.1f}' for value in place)
        told['aircraft_spread'] = f'{np.sqrt(np.trace(spread) / 3) * _MM:.1f}'
    return told


def _places(survey: Surveyed) -> dict[str, Any]:
    """What the page needs to tell the place of a pixel."""
    mosaic, cells = survey.mosaic, survey.mosaic.coverage()
    skin = mosaic.skin
    height = by_cell(mosaic, cells, skin.place(cells.positions.astype(float))[:, 2])
    findable = by_cell(mosaic, cells, cells.findable)
    return {
        'name': survey.result.name,
        'pixel': PIXEL,
        'side': cells.size,
        'low': mosaic.low.tolist(),
        'rows': height.shape[0],
        'columns': height.shape[1],
        'step': _STEP,
        'unknown': _UNKNOWN,
        'height': _coded(height),
        'findable': _coded(findable),
        'origin': skin.origin.tolist(),
        'axis': skin.axis.tolist(),
        'around': skin.around.tolist(),
        'normal': skin.normal.tolist(),
        'radius': float(skin.radius) if np.isfinite(skin.radius) else None,
    }


def _coded(values: NDArray[np.float64]) -> str:
    steps = np.where(np.isfinite(values), np.rint(values / _STEP), _UNKNOWN)
    return base64.b64encode(np.clip(steps, _UNKNOWN, 32767).astype('<i2').tobytes()).decode()
