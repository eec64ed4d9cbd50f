"""Imports run one way, and what flies loads nothing else; the contracts are in pyproject.toml."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from ftp_dent_ros.supervision.executables import NODES

ROOT = Path(__file__).resolve().parents[1]
NOT_FLOWN = ('matplotlib', 'jinja2', *(f'ftp_dent_ros.{room}' for room in (
    'simulation', 'demonstration', 'evaluation'
)))  # fmt: skip


def test_the_contracts_are_kept(capsys, monkeypatch):
    cli = pytest.importorskip('importlinter.cli', reason='import-linter is not installed')
    monkeypatch.chdir(ROOT)
    status = cli.lint_imports(config_filename=str(ROOT / 'pyproject.toml'), no_cache=True)
    assert status == 0, capsys.readouterr().out


def loaded(modules):
    """What importing some modules loads, in a process of its own."""
    code = 'import importlib, sys\nfor name in sys.argv[1:]: importlib.import_module(name)\n'
    done = subprocess.run(
        [sys.executable, '-c', f'{code}print(*sys.modules)', *modules],
        capture_output=True,
        text=True,
        check=True,
    )
    return set(done.stdout.split())


def test_what_checks_a_configuration_loads_no_ros_and_nothing_that_does_not_fly():
    modules = loaded(('ftp_dent_ros.nodes.settings',))
    assert not modules & {'rclpy', 'mcap', *NOT_FLOWN}


def test_the_nodes_load_nothing_that_does_not_fly():
    pytest.importorskip('rclpy', reason='rclpy is not installed')
    assert not loaded(f'ftp_dent_ros.nodes.{name}' for name in NODES) & set(NOT_FLOWN)
