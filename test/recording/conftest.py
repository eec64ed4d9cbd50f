"""Bags need the libraries `mcap` and `rosbags`, which are an extra."""

import importlib.util
import os
import subprocess
from pathlib import Path

import pytest
from skins import view  # noqa: F401

MISSING = [name for name in ('mcap', 'rosbags') if importlib.util.find_spec(name) is None]


class _Skipped(pytest.Module):
    def collect(self):
        pytest.skip(f'{" and ".join(MISSING)} not installed: nothing about bags is tested')


def pytest_pycollect_makemodule(module_path: Path, parent: pytest.Collector):
    return _Skipped.from_parent(parent, path=module_path) if MISSING else None


@pytest.fixture
def small_disk(tmp_path):
    """A file system of 1 MB."""
    folder = tmp_path / 'disk'
    folder.mkdir()
    command = ['mount', '-t', 'tmpfs', '-o', 'size=1m', 'none', str(folder)]
    if os.geteuid() != 0 or subprocess.run(command, capture_output=True, check=False).returncode:
        pytest.skip('no file system can be mounted here: a full disk is not tested')
    yield folder
    subprocess.run(['umount', '-l', str(folder)], check=True)
