"""A survey as files: pictures of the unrolled skin with their places, points, and a list."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.cloud.ply import write_ply
from ftp_dent_ros.files import write_png, written_aside
from ftp_dent_ros.survey.aircraft_frame import AircraftFrame
from ftp_dent_ros.survey.page import survey_page
from ftp_dent_ros.survey.skin_map.mosaic import PIXEL, PIXELS_A_CELL, Mosaic
from ftp_dent_ros.survey.surveying import Surveyed

# Depth that the picture of the deviation shows at its ends, metres.
_DEEPEST = 0.5e-3
# Views from which on the picture of the coverage is white.
_MANY = 10
_GREY = 40


def write_survey(
    folder: Path, survey: Surveyed, frame: AircraftFrame | None = None
) -> dict[str, Path]:
    """Write pictures, ``mosaic.ply``, ``survey.json`` and the page ``survey.html``.

    The pictures ``skin.png``, ``deviation.png`` and ``coverage.png`` show the unrolled skin from
    outside, 2 mm a pixel; the world file beside each (``.pgw``) says where its pixels lie on the
    unrolled skin, metres. Red is deep and blue is high, 0.5 mm at their fullest; of the coverage,
    black is not measured, white was seen ten times or more, and what is red is a gap.

    Parameters
    ----------
    folder : Path
    survey : Surveyed
    frame : AircraftFrame, optional
        In which places are given besides.

    Returns
    -------
    dict
        The files by their kind.
    """
    mosaic = survey.mosaic
    pictures = {
        'skin': mosaic.image,
        'deviation': _coloured(mosaic.deviation),
        'coverage': _coverage(mosaic),
    }
    files = {}
    for name, picture in pictures.items():
        files[name] = folder / f'{name}.png'
        # y grows upwards on the skin, rows grow downwards.
        write_png(files[name], picture[::-1])
        with written_aside(folder / f'{name}.pgw') as aside:
            aside.write_text(_world_file(mosaic), encoding='ascii')
    files['points'] = folder / 'mosaic.ply'
    write_ply(files['points'], mosaic.cloud(), survey.result.frame_id)
    files['list'] = folder / 'survey.json'
    with written_aside(files['list']) as aside:
        aside.write_text(json.dumps(fields(survey, frame), indent=1), encoding='utf-8')
    files['page'] = folder / 'survey.html'
    with written_aside(files['page']) as aside:
        aside.write_text(survey_page(survey, frame), encoding='utf-8', errors='backslashreplace')
    return files


def fields(survey: Surveyed, frame: AircraftFrame | None = None) -> dict[str, Any]:
    """All that is found, as JSON has it: metres but where the name says millimetres."""
    result, mosaic = survey.result, survey.mosaic
    cells = result.coverage
    skin = mosaic.skin
    return {
        'name': result.name,
        'sources': list(result.sources),
        'taken_ns': result.taken_ns,
        'frame_id': result.frame_id,
        'software': result.software,
        'rig': result.rig_id,
        'pairs': {'used': survey.pairs - survey.left_out, 'left_out': survey.left_out},
        'remarks': list(survey.remarks),
        'poses': [
            {
                'stamp_ns': stamp_ns,
                'position': pose.translation.tolist(),
                'quaternion': pose.quaternion.tolist(),
                'covariance': covariance.ravel().tolist(),
            }
            for stamp_ns, pose, covariance in zip(
                result.stamps_ns, result.poses, result.covariances, strict=True
            )
        ],
        'unrolled': {
            'origin': skin.origin.tolist(),
            'x_axis': skin.axis.tolist(),
            'y_axis': skin.around.tolist(),
            'normal': skin.normal.tolist(),
            'radius': skin.radius if np.isfinite(skin.radius) else None,
        },
        'dents': [
            {
                'number': each.number,
                'kind': each.dent.kind,
                'position': each.dent.position.tolist(),
                'unrolled': skin.place(each.dent.position)[:2].tolist(),
                'position_covariance': each.position_covariance.ravel().tolist(),
                **_on_aircraft(each.dent.position, frame),
                **{
                    f'{name}_mm': _millimetres(getattr(each.dent, name).value)
                    for name in ('length', 'width', 'depth')
                },
                **{
                    f'{name}_uncertainty_mm': _millimetres(getattr(each.dent, name).uncertainty)
                    for name in ('length', 'width', 'depth')
                },
                'sightings': each.sightings,
                'cut': bool(each.dent.is_cut),
                'reason': each.dent.reason,
            }
            for each in result.dents
        ],
        'coverage': {
            'cell_mm': PIXEL * PIXELS_A_CELL * 1e3,
            'area_m2': 0.0 if cells is None else len(cells.views) * cells.size**2,
            'findable_mm': _shares(None if cells is None else cells.findable),
            'gaps': [
                {
                    'unrolled': gap.place.tolist(),
                    'size_mm': (gap.size * 1e3).tolist(),
                    'area_m2': gap.area,
                }
                for gap in mosaic.gaps()
            ],
        },
    }


def _on_aircraft(
    position: NDArray[np.float64], frame: AircraftFrame | None
) -> dict[str, list[float]]:
    """Station, buttock line and water line of a place, and their standard uncertainties."""
    if frame is None:
        return {}
    place, spread = frame.place(position)
    return {
        'aircraft_mm': (place * 1e3).tolist(),
        'aircraft_uncertainty_mm': (np.sqrt(np.diag(spread)) * 1e3).tolist(),
    }


def _millimetres(value: float) -> float | None:
    return float(value) * 1e3 if np.isfinite(value) else None


def _shares(values: NDArray | None) -> dict[str, float | None]:
    """Median and 95th percentile of the smallest dents that would have been found."""
    known = np.zeros(0) if values is None else values[np.isfinite(values)]
    if not len(known):
        return {'median': None, 'p95': None}
    median, high = np.percentile(known, [50, 95]) * 1e3
    return {'median': float(median), 'p95': float(high)}


def _world_file(mosaic: Mosaic) -> str:
    """Six lines: pixel size, turns, and the place of the upper left pixel's middle."""
    left = mosaic.low[0] + PIXEL / 2
    top = mosaic.low[1] + PIXEL * (mosaic.shape[0] - 0.5)
    return ''.join(f'{value:.6f}\n' for value in (PIXEL, 0.0, 0.0, -PIXEL, left, top))


def _coloured(deviation: NDArray[np.float32]) -> NDArray[np.uint8]:
    """BGR: white at none, red where it is deep, blue where it is high, grey where not known."""
    share = np.clip(deviation / _DEEPEST, -1, 1)
    red, blue = np.maximum(share, 0), np.maximum(-share, 0)
    picture = 255 * np.stack([1 - red, 1 - red - blue, 1 - blue], axis=-1)
    known = np.isfinite(deviation)[..., None]
    return np.where(known, np.nan_to_num(picture), _GREY).astype(np.uint8)


def _coverage(mosaic: Mosaic) -> NDArray[np.uint8]:
    """BGR: brighter the more often it was seen, gaps red."""
    share = np.minimum(mosaic.views, _MANY) / _MANY
    picture = np.repeat((np.where(share > 0, 80 + 175 * share, 0))[..., None], 3, axis=-1)
    picture = np.ascontiguousarray(picture.astype(np.uint8))
    for gap in mosaic.gaps():
        low = np.floor((gap.place - gap.size / 2 - mosaic.low) / PIXEL).astype(int)
        high = np.ceil((gap.place + gap.size / 2 - mosaic.low) / PIXEL).astype(int)
        box = picture[low[1] : high[1], low[0] : high[0]]
        box[mosaic.views[low[1] : high[1], low[0] : high[0]] == 0] = (40, 40, 220)
        cv2.rectangle(picture, low.tolist(), high.tolist(), (40, 40, 220), 1)
    return picture
