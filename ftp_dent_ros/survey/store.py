"""Surveys of an aircraft in one SQLite file: each is added whole, and none is ever changed."""

from __future__ import annotations

import json
import math
import os
import sqlite3
import time
import zlib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.dents.dent import (
    Estimate,
    MeasuredDent,
    SmallestDent,
    dent_from_plain,
    dent_to_plain,
)
from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.files import check_writable
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.survey.result import CoverageCells, DentRelief, SurveyedDent, SurveyResult

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

_CELLS = {'positions': '<f4', 'findable': '<f4', 'noise': '<f4', 'views': '<i8', 'best': '<i8'}

Row = tuple[Any, ...]

_MM = 1e-3
_NOTHING = np.zeros((0, 3))


class SurveyStore:
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
        settings=SmallestDent(**json.loads(survey['settings'])),
        rig_id=survey['rig_id'],
        software=survey['software'],
    )


def _cells(row: Any) -> CoverageCells:
    values = {name: np.frombuffer(zlib.decompress(row[name]), k) for name, k in _CELLS.items()}
    values['positions'] = values['positions'].reshape(-1, 3)
    return CoverageCells(row['size'], **values)


def _relief(row: Any) -> DentRelief:
    heights = np.frombuffer(zlib.decompress(row['heights']), '<f4')
    return DentRelief(row['spacing'], heights.reshape(-1, row['columns']))


def _packed(values: NDArray[np.number], kind: str) -> bytes:
    return zlib.compress(np.asarray(values, kind).tobytes())


def _bytes(values: NDArray[np.float64]) -> bytes:
    return np.asarray(values, '<f8').tobytes()


def _floats(data: bytes) -> NDArray[np.float64]:
    return np.frombuffer(data, '<f8').copy()


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
        settings = SmallestDent(
            record['smallest_depth_mm'] * _MM, record['smallest_width_mm'] * _MM
        )
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
