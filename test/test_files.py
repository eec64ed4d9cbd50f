import pytest

from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.files import config_folder, find, written_aside


def test_a_file_is_whole_or_not_there(tmp_path):
    path = tmp_path / 'new' / 'result.txt'
    with pytest.raises(RuntimeError), written_aside(path) as aside:
        aside.write_text('half')
        raise RuntimeError
    assert list(path.parent.iterdir()) == []
    with written_aside(path) as aside:
        aside.write_text('whole')
        assert not path.exists()
    assert path.read_text() == 'whole'
    assert list(path.parent.iterdir()) == [path]


def test_an_old_result_survives_a_failure(tmp_path):
    path = tmp_path / 'result.txt'
    path.write_text('old')
    with pytest.raises(RuntimeError), written_aside(path) as aside:
        aside.write_text('half')
        raise RuntimeError
    assert path.read_text() == 'old'


def test_own_files_come_before_shipped_ones(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shipped = next(path for path in config_folder().iterdir() if path.is_file())
    assert find(shipped.name) == shipped
    (tmp_path / shipped.name).write_text('mine')
    assert find(shipped.name).resolve() == tmp_path / shipped.name
    with pytest.raises(ConfigurationError, match='no such file'):
        find('nothing_of_that_name.yaml')
