"""The script that makes the test environments: what it says, and when it makes one anew.

Its Python is a stand-in here that notes how it is called, since a real one would download.
"""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
STAND_IN = """#!/bin/sh
case "$1 $2" in
    --version*) echo Python 3.{minor}.0 ;;
    '-m venv') echo venv >>"{calls}"; mkdir -p "$3/bin"; cp "$0" "$3/bin/python" ;;
    '-m pip') shift 3; echo pip "$@" >>"{calls}"; {pip} ;;
    '-c '*exit*) set -- $(echo "$2" | tr -dc '0-9 '); [ {minor} -ge $2 ] && [ {minor} -le $5 ] ;;
    '-c '*sys.version*) echo 3.{minor} ;;
    '-c '*ensurepip*) {ensurepip} ;;
esac
"""


@pytest.fixture
def project(tmp_path):
    for part in ('tools/environment', 'setup.py', 'test/ubuntu24.04.txt'):
        (tmp_path / part).parent.mkdir(exist_ok=True)
        shutil.copy(ROOT / part, tmp_path / part)
    return tmp_path


@pytest.fixture
def make(project):
    calls = project / 'calls'

    def call(target, minor=12, machine='x86_64', pip='true', ensurepip='true', **variables):
        programs = project / 'programs'
        programs.mkdir(exist_ok=True)
        texts = {
            'uname': f'#!/bin/sh\n[ "$1" = -m ] && echo {machine} || echo Linux\n',
            'python3': STAND_IN.format(minor=minor, calls=calls, pip=pip, ensurepip=ensurepip),
        }
        for name, text in texts.items():
            (programs / name).write_text(text)
            (programs / name).chmod(0o755)
        calls.write_text('')
        result = subprocess.run(
            [project / 'tools' / 'environment', target],
            capture_output=True,
            text=True,
            env={
                'PATH': f'{programs}:{os.environ["PATH"]}',
                'PYTHON': str(programs / 'python3'),
                **variables,
            },
        )
        return result.returncode, ' '.join(result.stderr.split()), calls.read_text().split('\n')

    return call


def test_is_made_once_and_updated_when_the_build_file_changes(project, make):
    status, said, calls = make('test')
    assert (status, calls[0]) == (0, 'venv')
    assert 'Setting up .venv' in said
    assert calls[2] == 'pip -e .[ros,bags,display,ground,test,lint]'
    assert make('test') == (0, '', [''])
    assert make('ros') == (0, '', [''])
    with (project / 'setup.py').open('a') as file:
        file.write('# changed\n')
    status, said, calls = make('test')
    assert 'Updating .venv' in said
    assert calls[:2] == ['pip --upgrade pip>=23', 'pip -e .[ros,bags,display,ground,test,lint]']
    assert make('test') == (0, '', [''])


def test_is_made_anew_for_another_python_and_in_another_place(project, make, tmp_path_factory):
    make('test', minor=11)
    assert make('test', minor=12)[2][0] == 'venv'
    assert make('test', minor=12)[2] == ['']
    moved = tmp_path_factory.mktemp('elsewhere') / 'moved'
    shutil.copytree(project, moved)
    variables = {'PATH': f'{project}/programs:{os.environ["PATH"]}', 'PYTHON': 'python3'}
    words = [moved / 'tools' / 'environment', 'test']
    result = subprocess.run(words, capture_output=True, text=True, env=variables)
    assert 'Setting up .venv' in result.stderr


@pytest.mark.parametrize(
    ('place', 'reason'),
    [
        ({'machine': 'aarch64'}, 'x86-64 Linux only, and this is Linux aarch64'),
        ({'ROS_DISTRO': 'jazzy'}, 'ROS jazzy is sourced in this shell'),
        ({'AMENT_PREFIX_PATH': '/opt/ros'}, 'is sourced in this shell'),
    ],
)
def test_without_wheels_it_says_what_to_do_instead(make, place, reason):
    status, said, calls = make('ros', **place)
    assert (status, calls) == (2, [''])
    assert reason in said
    assert 'colcon build && source install/setup.bash ftp-dent demo' in said
    status, said, calls = make('test', **place)
    assert status == 0
    assert reason in said
    assert 'colcon test' in said
    assert calls[2] == 'pip -e .[bags,display,ground,test,lint]'


@pytest.mark.parametrize(
    ('place', 'reason'),
    [
        ({'minor': 9}, 'Python 3.10 or newer is needed'),
        ({'ensurepip': 'exit 1'}, 'sudo apt install python3-venv'),
    ],
)
def test_a_python_that_cannot_serve_is_named(make, place, reason):
    status, said, calls = make('test', **place)
    assert (status, calls) == (2, [''])
    assert reason in said


def test_a_python_without_wheels_runs_the_rest(make):
    status, said, calls = make('test', minor=14)
    assert (status, calls[2]) == (0, 'pip -e .[bags,display,ground,test,lint]')
    assert 'there are ROS wheels for Python 3.10 to 3.13 only' in said
