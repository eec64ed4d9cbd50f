"""Shared by all tests."""

import os
import signal
import sys
from pathlib import Path

import pytest

from ftp_dent_ros.process import one_for_blas

# Boards, a radio and the truth of photographs, which tests and benchmarks share.
sys.path.append(str(Path(__file__).resolve().parents[1] / 'benchmarks'))

# Where no bytecode may lie beside the package, each worker and process would compile it anew.
if os.environ.pop('PYTHONDONTWRITEBYTECODE', ''):
    os.environ['PYTHONPYCACHEPREFIX'] = str(Path(__file__).parents[1] / '.pytest_cache/bytecode')

# As for the commands; before any test loads NumPy.
one_for_blas()

# Commands are ended by these in tests; `nohup` and a shell's `&` have all processes ignore them.
for _number, _usual in (
    (signal.SIGINT, signal.default_int_handler),
    (signal.SIGHUP, signal.SIG_DFL),
    (signal.SIGTERM, signal.SIG_DFL),
):
    if signal.getsignal(_number) is signal.SIG_IGN:
        signal.signal(_number, _usual)

_NODES = Path(__file__).resolve().parent / 'ros'


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Several workers: each begins with its share of the tests of nodes, which take longest."""
    if hasattr(config, 'workerinput'):
        items[:] = _dealt(items, config.workerinput['workercount'])


def _dealt(items: list[pytest.Item], workers: int) -> list[pytest.Item]:
    """Even parts, one a worker, as `--dist worksteal` cuts the list; who is done takes of others.

    Tests of nodes mostly wait, each worker's on a ROS domain of its own: side by side they take
    less time. Their files stay whole, for the flights that their tests share.
    """
    files: dict[Path, list[pytest.Item]] = {}
    rest = []
    for item in items:
        is_of_nodes = _NODES in item.path.parents
        (files.setdefault(item.path, []) if is_of_nodes else rest).append(item)
    dealt: list[pytest.Item] = []
    for worker in range(workers):
        share = [item for file in list(files.values())[worker::workers] for item in file]
        end = len(items) * (worker + 1) // workers
        room = max(end - len(dealt) - len(share), 0)
        dealt += share + rest[:room]
        rest = rest[room:]
    return dealt + rest


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
