"""A survey of what ``ftp-dent inspect`` has written about a flight: dents without coverage."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.inspection.dent import Estimate, MeasuredDent
from ftp_dent_ros.inspection.settings import Settings
from ftp_dent_ros.survey.result import SurveyedDent, SurveyResult

_MM = 1e-3
_NOTHING = np.zeros((0, 3))


def survey_from_report(path: str | os.PathLike[str], name: str = '') -> SurveyResult:
    """Read a ``dents.json``, or a folder with one.

    Parameters
    ----------
    path : path
    name : str, optional
        Of the survey; the folder's by default.

    Raises
    ------
    ConfigurationError
        It is none.
    """
    path = Path(path)
    file = path / 'dents.json' if path.is_dir() else path
    try:
        record = json.loads(file.read_text('utf-8'))
        stamps = [f['stamp_ns'] for f in record['frames'] if f['stamp_ns'] is not None]
        written = datetime.fromisoformat(record['written'].replace('Z', '+00:00'))
        posed = [each['pose'] is not None for each in record['frames']]
        dents = tuple(map(_dent, [*record['dents'], *record['others']]))
        settings = Settings(record['smallest_depth_mm'] * _MM, record['smallest_width_mm'] * _MM)
        result = SurveyResult(
            name or file.resolve().parent.name,
            (record['source'],),
            min(stamps, default=int(written.timestamp()) * 10**9),
            record['frame_id'],
            dents,
            settings=settings,
            rig_id=(record['rig'] or {}).get('id', ''),
            software=record['software'],
        )
    except OSError as reason:
        if (file.parent / 'survey.json').exists():
            raise ConfigurationError(
                f'{path}: is of `ftp-dent survey`, which keeps what can be compared in the file '
                'of --store: give FILE.sqlite:NAME'
            ) from None
        raise ConfigurationError(
            f'{file}: cannot be read ({reason.strerror}): give what `ftp-dent inspect` has written'
        ) from None
    except (ValueError, KeyError, TypeError, AttributeError):
        raise ConfigurationError(
            f'{file}: is no dents.json of `ftp-dent inspect`: give one'
        ) from None
    if len(posed) > 1 and not all(posed):
        raise ConfigurationError(
            f'{file}: is of clouds without poses, each in a frame of its own: '
            'make a survey of the bag with `ftp-dent survey`'
        )
    return result


def _dent(record: Mapping[str, Any]) -> SurveyedDent:
    def estimate(name: str, factor: float, unit: str = '_mm') -> Estimate:
        values = (record[f'{name}{unit}'], record[f'{name}_uncertainty{unit}'])
        return Estimate(*(math.nan if each is None else each * factor for each in values))

    normal = np.array([record[f'normal_{axis}'] for axis in 'xyz'], float)
    clearance, spread = record['clearance_mm'], record['position_uncertainty_mm']
    radius = record['bottom_radius_mm']
    dent = MeasuredDent(
        kind=str(record['kind']),
        position=np.array([record[axis] for axis in 'xyz'], float),
        normal=normal,
        axis=np.cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))]),
        depth=estimate('depth', _MM),
        length=estimate('length', _MM),
        width=estimate('width', _MM),
        model_length=estimate('model_length', _MM),
        model_width=estimate('model_width', _MM),
        orientation=estimate('orientation', math.pi / 180, '_deg'),
        area=estimate('area', _MM**2, '_mm2'),
        volume=estimate('volume', _MM**3, '_mm3'),
        bottom_radius=math.nan if radius is None else radius * _MM,
        significance=float(record['significance']),
        is_cut=bool(record['is_cut']),
        outline=_NOTHING,
        length_profile=_NOTHING[:, :2],
        width_profile=_NOTHING[:, :2],
        reason=str(record['reason']),
        clearance=math.inf if clearance is None else clearance * _MM,
    )
    spread = (math.nan if spread is None else spread) * _MM
    return SurveyedDent(
        int(record['number']), dent, np.eye(3) * spread**2, int(record['sightings'])
    )
