"""Surveys kept in one file: whole or not there, never changed, and of no other kind of file."""

import sqlite3
from dataclasses import replace

import numpy as np
import pytest
from dent_samples import make_dent

from ftp_dent_ros.dents.dent import SmallestDent, dent_to_plain
from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.survey.result import CoverageCells, DentRelief, SurveyedDent, SurveyResult
from ftp_dent_ros.survey.store import SurveyStore


def survey(name='2026-03', taken_ns=5):
    heights = np.array([[np.nan, 1e-4, 2e-4], [0, -1e-4, 0], [1, 2, 3]], np.float32)
    dents = tuple(
        SurveyedDent(k, make_dent((0.1 * k, 0, 0.6)), np.eye(3) * 1e-6, 4, relief)
        for k, relief in ((1, DentRelief(2e-3, heights)), (2, None))
    )
    cells = np.arange(12, dtype=np.float32).reshape(4, 3)
    return SurveyResult(
        name,
        ('monday/bag',),
        taken_ns,
        'map',
        dents,
        CoverageCells(0.01, cells, cells[:, 0]),
        SmallestDent(2e-4),
        'abc',
        'ftp_dent_ros 0.1.0',
    )


def test_a_survey_comes_back_as_it_was(tmp_path):
    store = SurveyStore(tmp_path / 'aircraft.sqlite')
    store.add(survey())
    store.add(survey('2025-09', taken_ns=2))
    assert store.names() == ('2025-09', '2026-03')
    read, written = store.read('2026-03'), survey()
    for name in ('name', 'sources', 'taken_ns', 'frame_id', 'settings', 'rig_id'):
        assert getattr(read, name) == getattr(written, name)
    for one, other in zip(read.dents, written.dents, strict=True):
        assert dent_to_plain(one.dent) == dent_to_plain(other.dent)
        assert (one.number, one.sightings) == (other.number, other.sightings)
        np.testing.assert_array_equal(one.position_covariance, other.position_covariance)
    (one, none), (written_one, _) = read.dents, written.dents
    assert none.relief is None and one.relief.spacing == written_one.relief.spacing
    np.testing.assert_array_equal(one.relief.heights, written_one.relief.heights)
    for name in ('positions', 'findable'):
        np.testing.assert_array_equal(
            getattr(read.coverage, name), getattr(written.coverage, name)
        )


def test_nothing_that_is_there_is_changed_and_nothing_half_is_added(tmp_path):
    store = SurveyStore(tmp_path / 'aircraft.sqlite')
    store.add(survey())
    with pytest.raises(ConfigurationError, match=r'has a survey .* already'):
        store.add(survey())
    store.check_new('2026-04')
    with pytest.raises(ConfigurationError, match='cannot be used'):
        store.check_new('Flug \udcc3')
    with pytest.raises(ConfigurationError, match='cannot be used'):
        store.add(replace(survey('bad'), taken_ns=None))
    assert store.names() == ('2026-03',)
    with pytest.raises(ConfigurationError, match="has no survey 'bad': it has '2026-03'"):
        store.read('bad')
    file = sqlite3.connect(store.path)
    for change in ('UPDATE surveys SET taken_ns = 0', 'DELETE FROM surveys'):
        with pytest.raises(sqlite3.IntegrityError, match='never changed'):
            file.execute(change)
    file.close()


def test_other_files_are_refused(tmp_path):
    (tmp_path / 'text').write_text('no database at all, but longer than a header is')
    with pytest.raises(ConfigurationError, match='cannot be used as a file of surveys'):
        SurveyStore(tmp_path / 'text').names()
    other = sqlite3.connect(tmp_path / 'other.sqlite')
    other.execute('CREATE TABLE surveys (a)')
    other.commit()
    other.close()
    with pytest.raises(ConfigurationError, match='a database of something else'):
        SurveyStore(tmp_path / 'other.sqlite').add(survey())
    store = SurveyStore(tmp_path / 'later.sqlite')
    store.add(survey())
    file = sqlite3.connect(store.path)
    file.execute('PRAGMA user_version = 9')
    file.close()
    with pytest.raises(ConfigurationError, match='of another version'):
        store.names()
    with pytest.raises(ConfigurationError, match='cannot be used'):
        SurveyStore(tmp_path / 'text/aircraft.sqlite').check_new('2026-03')
