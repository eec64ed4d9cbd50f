"""Rows of the tables that a survey is kept in, made of its result and read again."""

from __future__ import annotations

import json
import time
import zlib
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.inspection.plain import dent_from_plain, dent_to_plain
from ftp_dent_ros.inspection.settings import Settings
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.survey.result import CoverageCells, Relief, SurveyedDent, SurveyResult

_CELLS = {'positions': '<f4', 'findable': '<f4', 'noise': '<f4', 'views': '<i8', 'best': '<i8'}

Row = tuple[Any, ...]


def survey_row(result: SurveyResult) -> Row:
    """A survey's own row, but for its number; that it is added now is in it."""
    settings = json.dumps(asdict(result.settings))
    return (
        *(result.name, result.taken_ns, time.time_ns(), result.frame_id),
        *(json.dumps(result.sources), settings, result.rig_id, result.software),
    )


def rows_of(result: SurveyResult) -> dict[str, list[Row]]:
    """Rows of the other tables, but for the survey's number, by the tables' names."""
    poses = zip(result.stamps_ns, result.poses, result.covariances, strict=True)
    reliefs = [(each.number, each.relief) for each in result.dents if each.relief is not None]
    return {
        'poses': [
            (stamp, *p.translation.tolist(), *p.quaternion.tolist(), _bytes(covariance))
            for stamp, p, covariance in poses
        ],
        'dents': [_dent_row(each) for each in result.dents],
        'reliefs': [
            (number, each.spacing, each.heights.shape[1], _packed(each.heights, '<f4'))
            for number, each in reliefs
        ],
        'coverage': [] if result.coverage is None else [_coverage_row(result.coverage)],
    }


def _coverage_row(cells: CoverageCells) -> Row:
    return (cells.size, *(_packed(getattr(cells, name), kind) for name, kind in _CELLS.items()))


def _dent_row(each: SurveyedDent) -> Row:
    dent = each.dent
    sizes = (dent.length.value, dent.width.value, dent.depth.value)
    place = (float(value) for value in dent.position)
    spread = _bytes(each.position_covariance)
    record = json.dumps(dent_to_plain(dent))
    return (each.number, dent.kind, *place, *map(float, sizes), each.sightings, spread, record)


def result_of(
    survey: Any, poses: list[Any], dents: list[Any], coverage: list[Any], reliefs: list[Any]
) -> SurveyResult:
    """The survey of the rows of its tables, by the names of their columns.

    Raises
    ------
    ValueError, KeyError, TypeError, zlib.error
        They are damaged.
    """
    about = {row['number']: _relief(row) for row in reliefs}
    return SurveyResult(
        name=survey['name'],
        sources=tuple(json.loads(survey['sources'])),
        taken_ns=survey['taken_ns'],
        frame_id=survey['frame_id'],
        dents=tuple(
            SurveyedDent(
                row['number'],
                dent_from_plain(json.loads(row['record'])),
                _floats(row['position_covariance']).reshape(3, 3),
                row['sightings'],
                about.get(row['number']),
            )
            for row in dents
        ),
        stamps_ns=tuple(row['stamp_ns'] for row in poses),
        poses=tuple(
            Pose.from_quaternion([row[f'q{axis}'] for axis in 'xyzw'], [row[a] for a in 'xyz'])
            for row in poses
        ),
        covariances=np.array([_floats(row['covariance']) for row in poses]).reshape(-1, 6, 6),
        coverage=_cells(coverage[0]) if coverage else None,
        settings=Settings(**json.loads(survey['settings'])),
        rig_id=survey['rig_id'],
        software=survey['software'],
    )


def _cells(row: Any) -> CoverageCells:
    values = {name: np.frombuffer(zlib.decompress(row[name]), k) for name, k in _CELLS.items()}
    values['positions'] = values['positions'].reshape(-1, 3)
    return CoverageCells(row['size'], **values)


def _relief(row: Any) -> Relief:
    heights = np.frombuffer(zlib.decompress(row['heights']), '<f4')
    return Relief(row['spacing'], heights.reshape(-1, row['columns']))


def _packed(values: NDArray[np.number], kind: str) -> bytes:
    return zlib.compress(np.asarray(values, kind).tobytes())


def _bytes(values: NDArray[np.float64]) -> bytes:
    return np.asarray(values, '<f8').tobytes()


def _floats(data: bytes) -> NDArray[np.float64]:
    return np.frombuffer(data, '<f8').copy()
