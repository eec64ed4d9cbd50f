"""The user's file of points whose coordinates on the aircraft are known.

::

    unit: in                # of the coordinates: mm, or in; mm by default
    uncertainty_mm: 1.0     # standard uncertainty of the coordinates; 1 by default
    points:
      - {name: rivet at frame 24, map: [1.204, 0.331, 2.950], at: [1043.5, -32.0, 96.2]}
      - {name: dent above it, dent: 12, at: [1051.0, -31.2, 104.6], uncertainty_mm: 3}

``at`` is station, buttock line, water line; ``map`` a place in the survey's frame, metres, and
``dent`` the number of one of its dents; ``map_uncertainty_mm`` is how well that place is known
among the others.
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.survey.aircraft_frame import ReferencePoint
from ftp_dent_ros.survey.result import SurveyResult
from ftp_dent_ros.yaml_file import read_yaml

_UNITS = {'mm': 1e-3, 'in': 25.4e-3}
# Millimetres: of a drawing's coordinates as they are found on the skin; and of a place in a map, a
# pixel of the skin's image or a dent's centre.
_ON_AIRCRAFT, _IN_MAP = 1.0, 0.5
_FIELDS = ('name', 'map', 'dent', 'at', 'uncertainty_mm', 'map_uncertainty_mm')


def read_reference_points(
    path: str | os.PathLike[str], survey: SurveyResult
) -> tuple[ReferencePoint, ...]:
    """Read the file for a survey.

    Raises
    ------
    ConfigurationError
        A field is missing, unknown or malformed, or names a dent that the survey has not.
    """
    data = read_yaml(path, ConfigurationError)
    try:
        _refuse_unknown(data, ('unit', 'uncertainty_mm', 'map_uncertainty_mm', 'points'), '')
        unit = data.get('unit', 'mm')
        if unit not in _UNITS:
            raise ConfigurationError(f'unit is {unit!r}: give mm or in')
        points = data.get('points')
        if not isinstance(points, list) or not points:
            raise ConfigurationError('points is no list of points: give three or more')
        return tuple(
            _point(each, f'points[{index}]', data, _UNITS[unit], survey)
            for index, each in enumerate(points)
        )
    except ConfigurationError as reason:
        raise ConfigurationError(f'{path}: {reason}') from None


def _point(
    item: Any, where: str, data: dict[str, Any], unit: float, survey: SurveyResult
) -> ReferencePoint:
    if not isinstance(item, dict):
        raise ConfigurationError(f'{where} is {item!r}: give at, and map or dent')
    _refuse_unknown(item, _FIELDS, f'{where}.')
    if ('map' in item) == ('dent' in item):
        raise ConfigurationError(f'{where} has both of map and dent, or none: give one of them')
    if 'dent' in item:
        found = [each for each in survey.dents if each.number == item['dent']]
        if not found:
            raise ConfigurationError(
                f'{where}.dent is {item["dent"]!r}: the survey {survey.name} has no such dent'
            )
        place = found[0].dent.position
    else:
        place = _place(item['map'], f'{where}.map')
    spread = _positive(item, data, 'map_uncertainty_mm', _IN_MAP, where) * 1e-3
    return ReferencePoint(
        str(item.get('name', where)),
        place,
        np.eye(3) * spread**2,
        _place(item.get('at'), f'{where}.at') * unit,
        _positive(item, data, 'uncertainty_mm', _ON_AIRCRAFT, where) * 1e-3,
    )


def _place(value: Any, where: str) -> NDArray[np.float64]:
    if not isinstance(value, list) or len(value) != 3 or not all(map(_is_number, value)):
        raise ConfigurationError(f'{where} is {value!r}: give three numbers')
    return np.array(value, float)


def _positive(
    item: dict[str, Any], data: dict[str, Any], name: str, default: float, where: str
) -> float:
    value = item.get(name, data.get(name, default))
    if not _is_number(value) or not value > 0:
        raise ConfigurationError(f'{where}: {name} is {value!r}: give millimetres, above 0')
    return float(value)


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


def _refuse_unknown(data: dict[Any, Any], known: Sequence[str], where: str) -> None:
    for name in data:
        if name not in known:
            raise ConfigurationError(f'{where}{name} is unknown: only {", ".join(known)} are')
