"""What all commands share."""

import subprocess
import sys

import pytest

from ftp_dent_ros.cli.main import main
from ftp_dent_ros.pattern import Pattern
from ftp_dent_ros.pattern_file import write_pattern


def test_a_reader_that_has_seen_enough_ends_a_command_without_a_word(tmp_path):
    write_pattern(tmp_path / 'pattern.yaml', Pattern(640, 480, 10.0, 320.0))
    words = ['pattern', str(tmp_path / 'pattern.yaml'), '--output', str(tmp_path / 'pattern.png')]
    with subprocess.Popen(
        [sys.executable, '-m', 'ftp_dent_ros.cli.main', *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as command:
        command.stdout.close()
        said = command.stderr.read()
    assert (command.returncode, said) == (141, '')
    assert (tmp_path / 'pattern.png').exists()


@pytest.mark.parametrize('name', ['x' * 300 + '.png', 'file/pattern.png', 'folder.png'])
def test_what_the_system_refuses_is_one_line_with_the_path(tmp_path, monkeypatch, capsys, name):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'file').write_text('mine')
    (tmp_path / 'folder.png').mkdir()
    write_pattern(tmp_path / 'pattern.yaml', Pattern(640, 480, 10.0, 320.0))
    before = sorted(tmp_path.rglob('*'))
    assert main(['pattern', 'pattern.yaml', '--output', name]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert name.partition('/')[0][:20] in line and 'check path' in line
    assert sorted(tmp_path.rglob('*')) == before
