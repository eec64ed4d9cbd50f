"""Shared by all tests."""

from pathlib import Path

import pytest


@pytest.fixture(scope='session')
def shared() -> Path:
    """The folder of scenes and flights that stands beside the project, not in it."""
    folder = Path(__file__).resolve().parents[2] / 'shared'
    if not (folder / 'eval').is_dir():
        pytest.skip(f'{folder} is not here: its scenes and its flight are not tested')
    return folder
