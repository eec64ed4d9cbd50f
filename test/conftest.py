"""Shared by all tests."""

from pathlib import Path

import pytest


@pytest.fixture(scope='session')
def data() -> Path:
    """The photographs and the flight that are shipped with the tests; see its README.md."""
    return Path(__file__).resolve().parent / 'data'


@pytest.fixture(scope='session')
def shared() -> Path:
    """The folder of more scenes that stands beside the project, not in it."""
    folder = Path(__file__).resolve().parents[2] / 'shared'
    if not (folder / 'eval').is_dir():
        pytest.skip(f'{folder} is not here: its scenes are not tested')
    return folder
