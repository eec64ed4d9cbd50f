"""A graph of one's own, whoever else is on the machine."""

import os
import subprocess
import sys

import pytest

from ftp_dent_ros.supervision.transport import exclusive, free_domain

TAKE = """
from ftp_dent_ros.supervision.transport import free_domain
with free_domain() as domain:
    print(domain, flush=True)
    input()
"""


def test_two_runs_never_share_a_domain_whatever_their_folders_are(tmp_path):
    runs = []
    for number in range(2):
        folder = tmp_path / str(number)
        folder.mkdir()
        environment = {**os.environ, 'TMPDIR': str(folder)}
        command = [sys.executable, '-c', TAKE]
        pipes = {'stdin': subprocess.PIPE, 'stdout': subprocess.PIPE, 'text': True}
        runs.append(subprocess.Popen(command, env=environment, **pipes))
    with free_domain() as mine:
        theirs = [int(run.stdout.readline()) for run in runs]
        assert len({mine, *theirs}) == 3
    for run in runs:
        run.communicate('\n', timeout=60)
        assert run.returncode == 0


def test_a_domain_is_given_back_however_its_run_ends():
    run = subprocess.Popen(
        [sys.executable, '-c', TAKE], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    name = f'domain/{int(run.stdout.readline())}'
    with pytest.raises(OSError, match='in use'):
        exclusive(name)
    run.kill()
    run.communicate()
    exclusive(name).close()


def test_the_environment_is_as_before(monkeypatch):
    monkeypatch.setenv('ROS_DOMAIN_ID', '77')
    monkeypatch.delenv('FASTRTPS_DEFAULT_PROFILES_FILE', raising=False)
    before = dict(os.environ)
    with free_domain() as domain:
        assert os.environ['ROS_DOMAIN_ID'] == str(domain)
        assert os.path.exists(os.environ['FASTRTPS_DEFAULT_PROFILES_FILE'])
    assert dict(os.environ) == before
