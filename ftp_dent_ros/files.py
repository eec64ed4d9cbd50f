"""Where the package's shared files are, and how a file is written without leaving halves."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import yaml

from ftp_dent_ros.errors import ConfigurationError, InputError


def config_folder() -> Path:
    """Folder of the shipped configuration files, however the package was installed.

    In a source tree (also through an editable install or a symlink) it is ``config/`` beside
    the package; installed, ``share/ftp_dent_ros/config`` under the prefix that holds the package.

    Raises
    ------
    ConfigurationError
        The installation has lost its ``config`` folder.
    """
    package = Path(__file__).resolve().parent
    if (package.parent / 'package.xml').is_file():
        return package.parent / 'config'
    for prefix in package.parents:
        folder = prefix / 'share' / 'ftp_dent_ros' / 'config'
        if folder.is_dir():
            return folder
    raise ConfigurationError(
        f'the configuration files of ftp_dent_ros were not found above {package}: reinstall it'
    )


def find(name: str | os.PathLike[str]) -> Path:
    """Path of a file of the user's or, if there is none of that name, of a shipped one.

    Raises
    ------
    ConfigurationError
        Neither exists.
    """
    given = Path(name).expanduser()
    if given.exists():
        return given
    shipped = config_folder() / given
    if not given.is_absolute() and shipped.is_file():
        return shipped
    raise ConfigurationError(
        f'{given}: no such file here nor among the shipped ones in {config_folder()}: '
        'check the path'
    )


def read_yaml(path: str | os.PathLike[str], error: type[InputError]) -> dict[str, Any]:
    """Mapping in a YAML file; `error` is raised if it is unreadable or not a mapping."""
    try:
        text = Path(path).read_text(encoding='utf-8')
    except (OSError, UnicodeDecodeError) as reason:
        raise error(f'{path}: cannot be read ({reason}): check the path') from None
    try:
        data = yaml.safe_load(text)
    except yaml.YAMLError as reason:
        where = getattr(reason, 'problem_mark', None)
        line = f' in line {where.line + 1}' if where else ''
        raise error(f'{path}: not valid YAML{line}: correct the file') from None
    if not isinstance(data, dict):
        raise error(f'{path}: holds no mapping of fields: correct the file')
    return data


@contextmanager
def written_aside(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary path beside `path` that takes its name only if all went well."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    aside = path.with_name(f'.{path.stem}.{os.getpid()}{path.suffix}')
    try:
        yield aside
        os.replace(aside, path)
    finally:
        aside.unlink(missing_ok=True)
