"""Shared by all tests."""

from pathlib import Path

import pytest

from ftp_dent_ros.threads import one_for_blas

# As for the commands; before any test loads NumPy.
one_for_blas()

_NODES = Path(__file__).resolve().parent / 'ros'


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Several workers: the tests of nodes come first, and so to one worker.

    They take longest, share flights and domains, and disturb one another. `--dist worksteal` gives
    each worker a part of the list as it stands, and the others' rest to who is done.
    """
    if hasattr(config, 'workerinput'):
        items.sort(key=lambda item: _NODES not in item.path.parents)


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
