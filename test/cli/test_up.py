import io
import sys
import time

import pytest

from ftp_dent_ros.cli import main
from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.supervision.processes import Processes, ProcessLog, Program, keep_running

BARE = (sys.executable, '-I', '-S', '-c')


class Run:
    """Runs `keep_running` until each program has printed so many lines, or long enough."""

    def __init__(self, *programs, lines):
        self.lines, self.said = [], []
        deadline = time.monotonic() + 60.0

        def stopping():
            assert time.monotonic() < deadline, (self.lines, self.said)
            came = [name for name, _ in self.lines]
            return all(came.count(name) >= number for name, number in lines.items())

        with Processes(lambda name, line: self.lines.append((name, line))) as self.processes:
            self.status = keep_running(
                programs, self.processes, self.said.append, stopping, first_delay=0.01
            )


def test_restarts_one_that_is_killed_and_leaves_the_others():
    dies = 'import os; print(os.getpid(), flush=True); os.kill(os.getpid(), 9)'
    stays = 'import signal; print("here", flush=True); signal.pause()'
    programs = Program('dies', (*BARE, dies)), Program('stays', (*BARE, stays))
    run = Run(*programs, lines={'dies': 3, 'stays': 1})
    assert run.status == 0
    assert run.lines.count(('stays', 'here')) == 1
    pids = [line for name, line in run.lines if name == 'dies']
    assert len(set(pids)) == len(pids) >= 3
    assert run.said[0] == 'dies was killed by SIGKILL: restarting it in 0.01 s'
    assert run.said[-1] == 'stopped'


def test_wrong_parameters_are_not_tried_again():
    run = Run(Program('wrong', (*BARE, 'print(1); raise SystemExit(2)')), lines={'wrong': 2})
    assert run.status == 2
    assert run.lines == [('wrong', '1')]
    assert run.said == [
        'wrong ended with status 2: it cannot run with what it was given, so it is not restarted',
        'no node is left to run',
    ]


def test_says_what_had_to_be_killed(monkeypatch):
    deaf = (
        'import signal; signal.signal(signal.SIGTERM, signal.SIG_IGN)\n'
        'print(1, flush=True)\nwhile True: signal.pause()'
    )
    patient = Processes.stop
    monkeypatch.setattr(Processes, 'stop', lambda self: patient(self, patience=0.1))
    run = Run(Program('deaf', (*BARE, deaf)), lines={'deaf': 1})
    assert 'deaf did not end when asked to, and was killed' in run.said


def test_dry_run_prints_the_commands(tmp_path, capsys, monkeypatch):
    monkeypatch.delenv('FASTRTPS_DEFAULT_PROFILES_FILE', raising=False)
    path = tmp_path / 'my payload.yaml'
    path.write_text('/left/reconstruction:\n  ros__parameters:\n    tau: 0.9\n')
    assert main.main(['up', str(path), '--dry-run']) == 0
    *variables, command = capsys.readouterr().out.splitlines()
    assert command == (
        f'{sys.executable} -m ftp_dent_ros.nodes reconstruction --ros-args -r '
        f"__node:=reconstruction -r __ns:=/left --params-file '{path}'"
    )
    assert all(line.startswith('FASTRTPS_DEFAULT_PROFILES_FILE=') for line in variables)


@pytest.mark.parametrize(
    ('text', 'words'),
    [
        ('recontsruction: {ros__parameters: {}}', "no node 'recontsruction': use one of"),
        ('reconstruction: {tau: 1}', 'reconstruction: needs a block ros__parameters'),
        ('reconstruction: 3', 'reconstruction: needs a block ros__parameters'),
        ('{}', 'names no node'),
        ('/**: {ros__parameters: {}}', 'names no node'),
        ('[1, 2]', 'holds no mapping'),
        (None, 'no such file'),
    ],
)
def test_a_wrong_configuration_is_one_line(tmp_path, capsys, text, words):
    path = tmp_path / 'payload.yaml'
    if text:
        path.write_text(text)
    assert main.main(['up', str(path)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f'ftp-dent up: {path}: ')
    assert words in line


def test_log_names_each_line_and_its_files_have_the_lines_alone(tmp_path):
    terminal = io.StringIO()
    with ProcessLog(['reconstruction', 'a/b'], tmp_path / 'log', terminal) as log:
        log.show('a/b', 'text')
        log.say('hello')
    assert terminal.getvalue() == '           a/b | text\n            up | hello\n'
    assert (tmp_path / 'log' / 'a.b.log').read_text() == 'text\n'
    assert (tmp_path / 'log' / 'reconstruction.log').read_text() == ''


def test_log_folder_that_cannot_be_made(tmp_path):
    (tmp_path / 'file').write_text('')
    with pytest.raises(ConfigurationError, match='no log can be written'):
        ProcessLog(['a'], tmp_path / 'file' / 'log')
