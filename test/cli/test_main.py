"""What all commands share."""

import os
import subprocess
import sys

import numpy as np
import pytest

from ftp_dent_ros.cli.main import main
from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.cloud.ply import write_ply
from ftp_dent_ros.pattern.file import write_pattern
from ftp_dent_ros.pattern.pattern import Pattern


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


def test_without_any_output_a_command_does_its_work(tmp_path):
    write_pattern(tmp_path / 'pattern.yaml', Pattern(640, 480, 10.0, 320.0))
    words = f'{sys.executable} -m ftp_dent_ros.cli.main pattern pattern.yaml --output a.png'
    done = subprocess.run(['sh', '-c', f'{words} >&- 2>&-'], cwd=tmp_path)
    assert done.returncode == 0
    assert (tmp_path / 'a.png').exists()


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


def test_names_that_are_no_utf_8_are_read_written_and_told(tmp_path):
    folder = tmp_path / os.fsdecode(b'caf\xe9 \xff')
    folder.mkdir()
    points = np.zeros((60, 60, 3), np.float32)
    points[..., 1], points[..., 0] = np.mgrid[:60, :60] * 2e-3
    points[..., 2] = 0.8
    write_ply(folder / 'cloud.ply', Cloud(points, np.full((60, 60), 80, np.float32)), 'camera')
    done = subprocess.run(
        [
            *(sys.executable, '-m', 'ftp_dent_ros.cli.main', 'inspect', folder / 'cloud.ply'),
            *('--output', folder / 'report'),
        ],
        capture_output=True,
        env={**os.environ, 'PYTHONIOENCODING': 'utf-8:strict'},
    )
    assert (done.returncode, done.stderr) == (0, b'')
    assert (folder / 'report/report.html').exists()
    assert rb'caf\udce9 \udcff' in done.stdout
