"""Surveys of an aircraft in one SQLite file: each is added whole, and none is ever changed."""

from __future__ import annotations

import io
import json
import os
import sqlite3
import time
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import asdict
from pathlib import Path

import numpy as np

from ftp_dent_ros.dents.dent import SmallestDent, dent_from_plain, dent_to_plain
from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.survey.result import CoverageCells, DentRelief, SurveyedDent, SurveyResult

# "FtpD", in the file's header; and of the table below.
_APPLICATION, _VERSION = 0x46747044, 3
_TABLE = """CREATE TABLE surveys (number INTEGER PRIMARY KEY, name TEXT NOT NULL UNIQUE,
    taken_ns INTEGER NOT NULL, added_ns INTEGER NOT NULL, record TEXT NOT NULL,
    arrays BLOB NOT NULL)"""
_CELLS = 'positions', 'findable'


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
        self.check_new(result.name)
        with self._opened() as file:
            values = result.name, result.taken_ns, time.time_ns(), *_packed(result)
            file.execute('INSERT INTO surveys VALUES (NULL, ?, ?, ?, ?, ?)', values)

    def names(self) -> tuple[str, ...]:
        """Names of the surveys, in the order of their flights.

        Raises
        ------
        ConfigurationError
            The file is something else.
        """
        with self._opened() as file:
            rows = file.execute('SELECT name FROM surveys ORDER BY taken_ns, number')
            return tuple(row['name'] for row in rows)

    def check_new(self, name: str) -> None:
        """See, before hours of work, that a survey of a name can be added.

        Raises
        ------
        ConfigurationError
            As for `add`.
        """
        with self._opened() as file:
            known = file.execute('SELECT 1 FROM surveys WHERE name = ?', (name,)).fetchone()
        if known:
            raise ConfigurationError(
                f'{self.path}: has a survey {name!r} already, and none is ever changed: give this '
                'one another name (--name)'
            )

    def read(self, name: str) -> SurveyResult:
        """A survey.

        Raises
        ------
        ConfigurationError
            There is none of that name, or it is damaged.
        """
        with self._opened() as file:
            row = file.execute('SELECT * FROM surveys WHERE name = ?', (name,)).fetchone()
        if row is None:
            known = ', '.join(map(repr, self.names())) or 'none yet'
            raise ConfigurationError(f'{self.path}: has no survey {name!r}: it has {known}')
        try:
            return _unpacked(row)
        except (ValueError, KeyError, TypeError, zipfile.BadZipFile, zlib.error) as reason:
            raise ConfigurationError(
                f'{self.path}: the survey {name!r} is damaged ({reason}): take a copy of the file'
            ) from None

    @contextmanager
    def _opened(self) -> Iterator[sqlite3.Connection]:
        """One transaction, taken back if it does not come to its end."""
        try:
            with closing(sqlite3.connect(self.path)) as file, file:
                file.row_factory = sqlite3.Row
                file.execute('BEGIN IMMEDIATE')
                self._prepare(file)
                yield file
        except (sqlite3.Error, UnicodeError) as reason:
            raise ConfigurationError(
                f'{self.path}: cannot be used as a file of surveys ({reason}): name another file'
            ) from None

    def _prepare(self, file: sqlite3.Connection) -> None:
        """Make the table of a new file; refuse one of others or of another version."""
        application, version, tables = file.execute(
            'SELECT application_id, user_version, (SELECT count(*) FROM sqlite_master) '
            'FROM pragma_application_id, pragma_user_version'
        ).fetchone()
        if not (application or version or tables):
            file.execute(f'PRAGMA application_id = {_APPLICATION}')
            file.execute(f'PRAGMA user_version = {_VERSION}')
            file.execute(_TABLE)
            for change in ('UPDATE', 'DELETE'):
                file.execute(
                    f'CREATE TRIGGER no_{change} BEFORE {change} ON surveys '
                    "BEGIN SELECT RAISE(ABORT, 'surveys are never changed'); END"
                )
        elif (application, version) != (_APPLICATION, _VERSION):
            raise ConfigurationError(
                f'{self.path}: is a database of something else, or of another version of this '
                'software: name another file'
            )


def _packed(result: SurveyResult) -> tuple[str, bytes]:
    """A survey as JSON, and its large arrays as an archive of numpy's."""
    coverage = result.coverage
    record = {
        'frame_id': result.frame_id,
        'sources': result.sources,
        'settings': asdict(result.settings),
        'rig_id': result.rig_id,
        'software': result.software,
        'cell': coverage.size,
        'dents': [
            {
                'number': each.number,
                'sightings': each.sightings,
                'position_covariance': each.position_covariance.tolist(),
                'spacing': each.relief and each.relief.spacing,
                'dent': dent_to_plain(each.dent),
            }
            for each in result.dents
        ],
    }
    arrays = {name: getattr(coverage, name) for name in _CELLS}
    arrays |= {f'relief {d.number}': d.relief.heights for d in result.dents if d.relief}
    archive = io.BytesIO()
    np.savez_compressed(archive, **arrays)
    return json.dumps(record), archive.getvalue()


def _unpacked(row: sqlite3.Row) -> SurveyResult:
    """The survey again."""
    record, arrays = json.loads(row['record']), np.load(io.BytesIO(row['arrays']))
    dents = [
        SurveyedDent(
            each['number'],
            dent_from_plain(each['dent']),
            np.array(each['position_covariance']),
            each['sightings'],
            each['spacing'] and DentRelief(each['spacing'], arrays[f'relief {each["number"]}']),
        )
        for each in record['dents']
    ]
    return SurveyResult(
        name=row['name'],
        sources=tuple(record['sources']),
        taken_ns=row['taken_ns'],
        frame_id=record['frame_id'],
        dents=tuple(dents),
        coverage=CoverageCells(record['cell'], *(arrays[name] for name in _CELLS)),
        settings=SmallestDent(**record['settings']),
        rig_id=record['rig_id'],
        software=record['software'],
    )
