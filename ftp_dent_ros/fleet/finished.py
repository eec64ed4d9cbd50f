"""Which results are there already, and of what they were made: the memory of a batch."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ftp_dent_ros import __version__
from ftp_dent_ros.files import written_aside

#: Written last into a result's folder: with it, the result is whole.
MARK = 'made_of.json'


def made_of(path: str | os.PathLike[str], settings: Mapping[str, Any]) -> dict[str, Any]:
    """What decides about a result: the input's files, as they are now, and the settings.

    Parameters
    ----------
    path : path
        A file, or a folder with all that is in it.
    settings : mapping
        Plain data.
    """
    path = Path(path)
    files = sorted(each for each in path.rglob('*') if each.is_file()) if path.is_dir() else [path]
    states = {each: each.stat() for each in files}
    return {
        'software': f'ftp_dent_ros {__version__}',
        'input': os.path.abspath(path),
        'files': {
            str(each.relative_to(path)) if path.is_dir() else each.name: {
                'bytes': state.st_size,
                'changed_ns': state.st_mtime_ns,
            }
            for each, state in states.items()
        },
        'settings': dict(settings),
    }


def is_made_of(folder: Path, origin: Mapping[str, Any]) -> bool:
    """Whether a folder holds a whole result of exactly that."""
    try:
        return json.loads((folder / MARK).read_text('utf-8')) == origin
    except (OSError, ValueError):
        return False


def begin(folder: Path) -> None:
    """The result in a folder, if there is one, is no longer a whole one."""
    (folder / MARK).unlink(missing_ok=True)


def finish(folder: Path, origin: Mapping[str, Any]) -> None:
    """The result in a folder is whole."""
    with written_aside(folder / MARK) as aside:
        aside.write_text(json.dumps(origin, indent=1) + '\n', encoding='utf-8')
