"""Surveys of an aircraft in one SQLite file: each is added whole, and none is ever changed."""

from __future__ import annotations

import os
import sqlite3
import zlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.files import check_writable
from ftp_dent_ros.survey.result import SurveyResult
from ftp_dent_ros.survey.store_rows import result_of, rows_of, survey_row

# "FtpD", in the file's header; and of the tables below.
_APPLICATION, VERSION = 0x46747044, 2
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
# Those that files of the version before lack: they are added, empty, when one is opened.
_SINCE_1 = ('reliefs',)


class Store:
    """The file of an aircraft's surveys.

    Parameters
    ----------
    path : path
        Made with the first survey.
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
            _refuse_known(self.path, result.name, _names(file))
            survey = _insert(file, 'surveys', (None,), [survey_row(result)])
            for table, rows in rows_of(result).items():
                _insert(file, table, (survey,), rows)

    def names(self) -> tuple[str, ...]:
        """Names of the surveys, in the order of their flights.

        Raises
        ------
        ConfigurationError
            The file is something else.
        """
        if not self.path.exists():
            return ()
        with self._opened() as file:
            return _names(file)

    def check_new(self, name: str) -> None:
        """See, before hours of work, that a survey of a name can be added.

        Raises
        ------
        ConfigurationError
            As for `add`.
        """
        if not self.path.exists():
            check_writable(self.path)
        _refuse_known(self.path, name, self.names())

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
            file.row_factory = sqlite3.Row
            survey = file.execute('SELECT * FROM surveys WHERE name = ?', (name,)).fetchone()
            found = {
                table: file.execute(
                    f'SELECT * FROM {table} WHERE survey = ? ORDER BY rowid', (survey['number'],)
                ).fetchall()
                for table in ('poses', 'dents', 'coverage', 'reliefs')
            }
        try:
            return result_of(survey, **found)
        except (ValueError, KeyError, TypeError, zlib.error) as reason:
            raise ConfigurationError(
                f'{self.path}: the survey {name!r} is damaged ({reason}): take a copy of the file'
            ) from None

    @contextmanager
    def _opened(self) -> Iterator[sqlite3.Connection]:
        """One transaction, taken back if it does not come to its end."""
        file: sqlite3.Connection | None = None
        try:
            file = sqlite3.connect(self.path)
            with file:
                file.execute('PRAGMA foreign_keys = ON')
                file.execute('BEGIN IMMEDIATE')
                self._prepare(file)
                yield file
        except sqlite3.Error as reason:
            raise ConfigurationError(
                f'{self.path}: cannot be used as a file of surveys ({reason}): name another file'
            ) from None
        finally:
            if file is not None:
                file.close()

    def _prepare(self, file: sqlite3.Connection) -> None:
        """Make the tables of a new file; refuse one of others or of a later version."""
        (application,) = file.execute('PRAGMA application_id').fetchone()
        (version,) = file.execute('PRAGMA user_version').fetchone()
        (tables,) = file.execute('SELECT count(*) FROM sqlite_master').fetchone()
        if not (application or version or tables):
            file.execute(f'PRAGMA application_id = {_APPLICATION}')
            file.execute(f'PRAGMA user_version = {VERSION}')
            _make(file, _TABLES)
        elif application != _APPLICATION:
            raise ConfigurationError(
                f'{self.path}: is a database of something else: name another file'
            )
        elif version == 1:
            file.execute(f'PRAGMA user_version = {VERSION}')
            _make(file, _SINCE_1)
        elif version != VERSION:
            raise ConfigurationError(
                f'{self.path}: has the version {version} of its tables, and this software reads '
                f'{VERSION}: use the software that wrote it'
            )


def _names(file: sqlite3.Connection) -> tuple[str, ...]:
    rows = file.execute('SELECT name FROM surveys ORDER BY taken_ns, number').fetchall()
    return tuple(name for (name,) in rows)


def _refuse_known(path: Path, name: str, known: tuple[str, ...]) -> None:
    if not name or any('\ud800' <= each <= '\udfff' for each in name):
        raise ConfigurationError(
            f'{path}: no survey can be called {name!r}, which is no text: give another name '
            '(--name)'
        )
    if name in known:
        raise ConfigurationError(
            f'{path}: has a survey {name!r} already, and none is ever changed: give this one '
            'another name (--name)'
        )


def _make(file: sqlite3.Connection, tables: Iterable[str]) -> None:
    for table in tables:
        file.execute(f'CREATE TABLE {table} ({_TABLES[table]})')
        for change in ('UPDATE', 'DELETE'):
            file.execute(
                f'CREATE TRIGGER no_{change}_of_{table} BEFORE {change} ON {table} '
                "BEGIN SELECT RAISE(ABORT, 'surveys are never changed'); END"
            )


def _insert(
    file: sqlite3.Connection, table: str, first: tuple[Any, ...], rows: Iterable[tuple[Any, ...]]
) -> int | None:
    """Add rows, each after the same first values; the number of the last one."""
    last = None
    for row in rows:
        values = (*first, *row)
        marks = ', '.join('?' * len(values))
        last = file.execute(f'INSERT INTO {table} VALUES ({marks})', values).lastrowid
    return last
