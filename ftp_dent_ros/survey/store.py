"""Surveys of an aircraft in one SQLite file: each is added whole, and none is ever changed."""

from __future__ import annotations

import json
import os
import sqlite3
import time
import zlib
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.dents.dent import SmallestDent, dent_from_plain, dent_to_plain
from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.survey.result import CoverageCells, DentRelief, SurveyedDent, SurveyResult

# "FtpD", in the file's header; and of the tables below.
_APPLICATION, _VERSION = 0x46747044, 2
_TABLES = {
    'surveys': """number INTEGER PRIMARY KEY, name TEXT NOT NULL UNIQUE, taken_ns INTEGER NOT NULL,
        added_ns INTEGER NOT NULL, frame_id TEXT NOT NULL, sources TEXT NOT NULL,
        settings TEXT NOT NULL, rig_id TEXT NOT NULL, software TEXT NOT NULL""",
    'poses': """survey INTEGER NOT NULL REFERENCES surveys, stamp_ns INTEGER NOT NULL,
        x REAL, y REAL, z REAL, qx REAL, qy REAL, qz REAL, qw REAL, covariance BLOB""",
    'dents': """survey INTEGER NOT NULL REFERENCES surveys, number INTEGER NOT NULL,
        kind TEXT NOT NULL, x REAL, y REAL, z REAL, length REAL, width REAL, depth REAL,
        sightings INTEGER, position_covariance BLOB, record TEXT NOT NULL,
        PRIMARY KEY (survey, number)""",
    'coverage': """survey INTEGER PRIMARY KEY REFERENCES surveys, size REAL, positions BLOB,
        findable BLOB, noise BLOB, views BLOB, best BLOB""",
    'reliefs': """survey INTEGER NOT NULL REFERENCES surveys, number INTEGER NOT NULL,
        spacing REAL, columns INTEGER, heights BLOB, PRIMARY KEY (survey, number)""",
}
_CELLS = {'positions': '<f4', 'findable': '<f4', 'noise': '<f4', 'views': '<i8', 'best': '<i8'}


class SurveyStore:
    """The file of an aircraft's surveys.

    Parameters
    ----------
    path : path
        Made when it is first used.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)

    def add(self, result: SurveyResult) -> None:
        """Add a survey in one transaction: all of it is there afterwards, or nothing.

        Raises
        ------
        ConfigurationError
            There is one of that name, or the file cannot be written, or is something else.
        """
        with self._opened() as file:
            self._refuse_known(file, result.name)
            _write(file, result)

    def names(self) -> tuple[str, ...]:
        """Names of the surveys, in the order of their flights.

        Raises
        ------
        ConfigurationError
            The file is something else.
        """
        with self._opened() as file:
            rows = file.execute('SELECT name FROM surveys ORDER BY taken_ns, number').fetchall()
            return tuple(row['name'] for row in rows)

    def check_new(self, name: str) -> None:
        """See, before hours of work, that a survey of a name can be added.

        Raises
        ------
        ConfigurationError
            As for `add`.
        """
        with self._opened() as file:
            self._refuse_known(file, name)

    def read(self, name: str) -> SurveyResult:
        """A survey.

        Raises
        ------
        ConfigurationError
            There is none of that name, or it is damaged.
        """
        names = self.names()
        if name not in names:
            known = ', '.join(map(repr, names)) or 'none yet'
            raise ConfigurationError(f'{self.path}: has no survey {name!r}: it has {known}')
        with self._opened() as file:
            try:
                return _read(file, name)
            except (ValueError, KeyError, TypeError, zlib.error) as reason:
                raise ConfigurationError(
                    f'{self.path}: the survey {name!r} is damaged ({reason}): take a copy of the '
                    'file'
                ) from None

    @contextmanager
    def _opened(self) -> Iterator[sqlite3.Connection]:
        """One transaction, taken back if it does not come to its end."""
        try:
            with closing(sqlite3.connect(self.path)) as file, file:
                file.row_factory = sqlite3.Row
                file.execute('PRAGMA foreign_keys = ON')
                file.execute('BEGIN IMMEDIATE')
                self._prepare(file)
                yield file
        except (sqlite3.Error, UnicodeError) as reason:
            raise ConfigurationError(
                f'{self.path}: cannot be used as a file of surveys ({reason}): name another file'
            ) from None

    def _prepare(self, file: sqlite3.Connection) -> None:
        """Make the tables of a new file; refuse one of others or of another version."""
        (application,) = file.execute('PRAGMA application_id').fetchone()
        (version,) = file.execute('PRAGMA user_version').fetchone()
        (tables,) = file.execute('SELECT count(*) FROM sqlite_master').fetchone()
        if not (application or version or tables):
            file.execute(f'PRAGMA application_id = {_APPLICATION}')
            file.execute(f'PRAGMA user_version = {_VERSION}')
            for table, columns in _TABLES.items():
                file.execute(f'CREATE TABLE {table} ({columns})')
                for change in ('UPDATE', 'DELETE'):
                    file.execute(
                        f'CREATE TRIGGER no_{change}_of_{table} BEFORE {change} ON {table} '
                        "BEGIN SELECT RAISE(ABORT, 'surveys are never changed'); END"
                    )
        elif (application, version) != (_APPLICATION, _VERSION):
            raise ConfigurationError(
                f'{self.path}: is a database of something else, or of another version of this '
                'software: name another file'
            )

    def _refuse_known(self, file: sqlite3.Connection, name: str) -> None:
        if file.execute('SELECT 1 FROM surveys WHERE name = ?', (name,)).fetchone():
            raise ConfigurationError(
                f'{self.path}: has a survey {name!r} already, and none is ever changed: give this '
                'one another name (--name)'
            )


def _write(file: sqlite3.Connection, result: SurveyResult) -> None:
    def insert(table: str, *values: Any) -> int | None:
        marks = ', '.join('?' * len(values))
        return file.execute(f'INSERT INTO {table} VALUES ({marks})', values).lastrowid

    settings, sources = json.dumps(asdict(result.settings)), json.dumps(result.sources)
    about = result.name, result.taken_ns, time.time_ns(), result.frame_id, sources, settings
    survey = insert('surveys', None, *about, result.rig_id, result.software)
    for stamp_ns, pose, covariance in zip(
        result.stamps_ns, result.poses, result.covariances, strict=True
    ):
        place = *pose.translation.tolist(), *pose.quaternion.tolist()
        insert('poses', survey, stamp_ns, *place, _bytes(covariance))
    for each in result.dents:
        dent = each.dent
        sizes = dent.length.value, dent.width.value, dent.depth.value
        values = map(float, (*dent.position, *sizes))
        covariance, record = _bytes(each.position_covariance), json.dumps(dent_to_plain(dent))
        counted = each.sightings, covariance, record
        insert('dents', survey, each.number, dent.kind, *values, *counted)
        if each.relief is not None:
            heights = each.relief.heights
            packed = _packed(heights, '<f4')
            insert('reliefs', survey, each.number, each.relief.spacing, heights.shape[1], packed)
    cells = [_packed(getattr(result.coverage, name), kind) for name, kind in _CELLS.items()]
    insert('coverage', survey, result.coverage.size, *cells)


def _read(file: sqlite3.Connection, name: str) -> SurveyResult:
    survey = file.execute('SELECT * FROM surveys WHERE name = ?', (name,)).fetchone()

    def rows_of(table: str) -> list[sqlite3.Row]:
        query = f'SELECT * FROM {table} WHERE survey = ? ORDER BY rowid'
        return file.execute(query, (survey['number'],)).fetchall()

    poses, (cells,) = rows_of('poses'), rows_of('coverage')
    reliefs = {
        row['number']: DentRelief(
            row['spacing'], _unpacked(row['heights'], '<f4').reshape(-1, row['columns'])
        )
        for row in rows_of('reliefs')
    }
    values = {name: _unpacked(cells[name], kind) for name, kind in _CELLS.items()}
    values['positions'] = values['positions'].reshape(-1, 3)
    return SurveyResult(
        name=name,
        sources=tuple(json.loads(survey['sources'])),
        taken_ns=survey['taken_ns'],
        frame_id=survey['frame_id'],
        dents=tuple(
            SurveyedDent(
                row['number'],
                dent_from_plain(json.loads(row['record'])),
                np.frombuffer(row['position_covariance']).reshape(3, 3),
                row['sightings'],
                reliefs.get(row['number']),
            )
            for row in rows_of('dents')
        ),
        coverage=CoverageCells(cells['size'], **values),
        stamps_ns=tuple(row['stamp_ns'] for row in poses),
        poses=tuple(
            Pose.from_quaternion([row[f'q{axis}'] for axis in 'xyzw'], [row[a] for a in 'xyz'])
            for row in poses
        ),
        covariances=np.array([np.frombuffer(row['covariance']) for row in poses]).reshape(
            -1, 6, 6
        ),
        settings=SmallestDent(**json.loads(survey['settings'])),
        rig_id=survey['rig_id'],
        software=survey['software'],
    )


def _bytes(values: NDArray[np.float64]) -> bytes:
    return np.asarray(values, '<f8').tobytes()


def _packed(values: NDArray[np.number], kind: str) -> bytes:
    return zlib.compress(np.asarray(values, kind).tobytes())


def _unpacked(packed: bytes, kind: str) -> NDArray[Any]:
    return np.frombuffer(zlib.decompress(packed), kind)
