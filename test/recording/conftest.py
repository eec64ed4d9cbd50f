"""Bags need the libraries `mcap` and `rosbags`, which are an extra."""

import importlib.util
from pathlib import Path

import pytest

MISSING = [name for name in ('mcap', 'rosbags') if importlib.util.find_spec(name) is None]


class _Skipped(pytest.Module):
    def collect(self):
        pytest.skip(f'{" and ".join(MISSING)} not installed: nothing about bags is tested')


def pytest_pycollect_makemodule(module_path: Path, parent: pytest.Collector):
    return _Skipped.from_parent(parent, path=module_path) if MISSING else None
