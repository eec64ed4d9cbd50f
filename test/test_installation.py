"""Installs the package in each way there is and asks whether its commands and files are found.

Each installation gets an empty environment that sees the libraries of this one, so that nothing
is downloaded.
"""

import json
import os
import shutil
import site
import subprocess
import sys
import venv
from pathlib import Path

import pytest

from ftp_dent_ros import __version__
from ftp_dent_ros.supervision.executables import EXECUTABLES

ROOT = Path(__file__).resolve().parents[1]
PARTS = (
    *('ftp_dent_ros', 'config', 'launch', 'hook', 'resource'),
    *('package.xml', 'setup.py', 'setup.cfg', 'pyproject.toml', 'colcon.pkg', 'LICENSE'),
)
COMMANDS = {'ftp-dent', *EXECUTABLES}
ASK = (
    'import json, ftp_dent_ros\nfrom importlib import resources\nfrom ftp_dent_ros import files\n'
    'report = resources.files("ftp_dent_ros.inspection")\n'
    'assert all(report.joinpath(name).is_file() for name in ("page.html", "view.js"))\n'
    'print(json.dumps([ftp_dent_ros.__file__, str(files.config_folder())]))'
)


def call(*words, **options):
    result = subprocess.run(
        [str(word) for word in words],
        capture_output=True,
        text=True,
        stdin=subprocess.DEVNULL,
        **options,
    )
    assert result.returncode == 0, f'{words}\n{result.stdout}\n{result.stderr}'
    return result.stdout.strip()


@pytest.fixture
def source(tmp_path):
    """A copy of what a clone holds, so that building leaves nothing in the tree under test."""
    copy = tmp_path / 'source'
    copy.mkdir()
    for part in PARTS:
        if (ROOT / part).is_dir():
            shutil.copytree(ROOT / part, copy / part, ignore=shutil.ignore_patterns('__pycache__'))
        else:
            shutil.copy(ROOT / part, copy / part)
    return copy


@pytest.fixture
def environment(tmp_path, monkeypatch):
    """An environment without pip whose libraries are this one's, less this package."""
    for name in ('PYTHONPATH', 'AMENT_PREFIX_PATH', 'COLCON_PREFIX_PATH'):
        monkeypatch.delenv(name, raising=False)
    folder = tmp_path / 'environment'
    venv.create(folder, with_pip=False)
    (packages,) = folder.glob('lib/python3*/site-packages')
    # A path alone: the .pth files there, an editable installation of this package among them,
    # are not followed.
    (packages / 'libraries.pth').write_text('\n'.join(site.getsitepackages()) + '\n')
    return folder


def ask(*words, **options):
    """Where the package and its configuration files are, as a Python started so finds them."""
    package, config = json.loads(call(*words, '-c', ASK, **options))
    assert not Path(package).is_relative_to(ROOT)
    return Path(config)


def pip_install(environment, *words):
    call(
        *(sys.executable, '-m', 'pip', '--python', environment / 'bin' / 'python', 'install'),
        *('--no-deps', '--no-build-isolation', '--no-index', '--ignore-installed'),
        *('--disable-pip-version-check', *words),
    )


@pytest.mark.parametrize('editable', [False, True], ids=['plain', 'editable'])
def test_pip(source, environment, tmp_path, editable):
    pytest.importorskip('wheel', reason='wheel is not installed')
    pip_install(environment, *(['-e', source] if editable else [source]))
    share, commands = environment / 'share', environment / 'bin'
    assert {path.name for path in commands.iterdir()} >= COMMANDS
    assert call(commands / 'ftp-dent', '--version', cwd=tmp_path) == __version__
    config = source / 'config' if editable else share / 'ftp_dent_ros' / 'config'
    assert ask(commands / 'python', cwd=tmp_path) == config
    if not editable:
        assert same_files(config, source / 'config')
        assert (share / 'ament_index/resource_index/packages/ftp_dent_ros').exists()


@pytest.mark.parametrize('symlink', [False, True], ids=['copied', 'symlink'])
def test_colcon(source, environment, tmp_path, symlink):
    pytest.importorskip('colcon_core', reason='colcon is not installed')
    python = environment / 'bin' / 'python'
    words = ('--symlink-install',) if symlink else ()
    call(python, '-m', 'colcon', 'build', '--base-paths', source, *words, cwd=tmp_path)
    prefix = tmp_path / 'install' / 'ftp_dent_ros'
    share = prefix / 'share' / 'ftp_dent_ros'
    # Where `ros2 run` looks.
    assert {path.name for path in (prefix / 'lib' / 'ftp_dent_ros').iterdir()} == COMMANDS
    assert (prefix / 'share/ament_index/resource_index/packages/ftp_dent_ros').exists()
    assert (share / 'package.xml').exists()
    assert (share / 'launch' / 'payload.launch.py').exists()
    assert same_files(share / 'config', source / 'config')

    sourced = ('bash', '-c', '. "$0" && exec "$@"', tmp_path / 'install' / 'setup.bash')
    config = source / 'config' if symlink else share / 'config'
    assert ask(*sourced, python, cwd=tmp_path) == config
    # On Ubuntu OpenCV is not a distribution of PyPI's name: no script may ask for one.
    (libraries,) = environment.glob('lib/python3*/site-packages/libraries.pth')
    libraries.unlink()
    assert call(*sourced, 'ftp-dent', '--version', cwd=tmp_path) == __version__


def test_from_the_source_tree(source, tmp_path):
    options = {'cwd': tmp_path, 'env': {**os.environ, 'PYTHONPATH': str(source)}}
    assert ask(sys.executable, **options) == source / 'config'
    words = (sys.executable, '-m', 'ftp_dent_ros.cli.main', '--version')
    assert call(*words, **options) == __version__


def same_files(folder, other):
    names = {path.name for path in folder.iterdir()}
    assert names == {path.name for path in other.iterdir()}
    return all((folder / name).read_bytes() == (other / name).read_bytes() for name in names)
