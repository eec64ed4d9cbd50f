"""Where the package's shared files are, and how a file is written without leaving halves."""

from __future__ import annotations

import errno
import hashlib
import os
import re
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ftp_dent_ros.errors import ConfigurationError

if TYPE_CHECKING:
    from numpy.typing import NDArray

#: What the name of a file of the package begins with.
SHIPPED = 'shipped:'


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
    """Path of a file of the user's, or of a shipped one by ``shipped:NAME``.

    A shipped file never stands in for one of the user's: it holds the demonstration's
    calibration, not that of the user's rig.

    Raises
    ------
    ConfigurationError
        There is no such file.
    """
    text = os.fspath(name)
    if text.startswith(SHIPPED):
        names = sorted(path.name for path in config_folder().iterdir() if path.is_file())
        shipped = text.removeprefix(SHIPPED)
        if shipped in names:
            return config_folder() / shipped
        raise ConfigurationError(
            f'{text}: no file of that name is shipped: give one of {", ".join(names)}'
        )
    path = Path(text).expanduser()
    if path.exists():
        return path
    where = '' if path.is_absolute() else f' in {Path.cwd()}'
    advice = 'check the path'
    if (config_folder() / path.name).is_file():
        advice += f', or give {SHIPPED}{path.name} for the example that is shipped'
    raise ConfigurationError(f'{path}: no such file{where}: {advice}')


def by_number(path: Path) -> list[tuple[int, int, str]]:
    """Sorting key by which ``2.png`` stands before ``10.png``."""
    parts = re.split(r'(\d+)', str(path))
    return [(0, int(part), '') if part.isdigit() else (1, 0, part) for part in parts]


def content_id(path: str | os.PathLike[str]) -> str:
    """First twelve digits of the SHA-256 of a file: another content has another id.

    Raises
    ------
    ConfigurationError
        The file cannot be read.
    """
    try:
        return hashlib.sha256(Path(path).read_bytes()).hexdigest()[:12]
    except OSError as reason:
        raise ConfigurationError(
            f'{path}: cannot be read ({reason.strerror}): check the path'
        ) from None


def write_png(path: str | os.PathLike[str], image: NDArray[Any]) -> None:
    """Write an image as OpenCV has it (grey, BGR or BGRA) as PNG, as of `write_atomically`."""
    # Taken only here: most of what reads and writes files has no images.
    import cv2

    _, data = cv2.imencode('.png', image)
    with write_atomically(path) as temporary:
        temporary.write_bytes(data.tobytes())


def check_writable(path: str | os.PathLike[str], name: str = '') -> None:
    """Raise `ConfigurationError`, before minutes of work, if a file cannot be written.

    It calls it by a name, or by its path. Nothing is left of the trial.
    """
    try:
        if Path(path).is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
        with tempfile.TemporaryFile(dir=nearest_folder(path)):
            pass
    except OSError as reason:
        raise ConfigurationError(
            f'{name or path}: cannot be written ({reason.strerror}): give another place'
        ) from None


def nearest_folder(path: str | os.PathLike[str]) -> Path:
    """What of the folders above a file is there: the file is going to be on its disk."""
    return next(each for each in Path(path).absolute().parents if each.exists())


@contextmanager
def write_atomically(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary path beside `path` that takes its name only if all went well.

    Raises
    ------
    OSError
        It cannot be written; `filename` is `path`.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f'.{path.stem}.{os.getpid()}{path.suffix}')
    try:
        yield temporary
        os.replace(temporary, path)
    except OSError as reason:
        # A full disk names no file, and nobody knows the temporary one.
        if reason.filename in (None, str(temporary), temporary):
            reason.filename, reason.filename2 = str(path), None
        raise
    finally:
        temporary.unlink(missing_ok=True)


@contextmanager
def write_all_atomically(
    folder: str | os.PathLike[str], names: Iterable[str], what: str
) -> Iterator[dict[str, Path]]:
    """Yield a temporary path for each name; the files are there only if all went well.

    Raises
    ------
    ConfigurationError
        They cannot be written: `what` they are, say ``'the report'``.
    """
    try:
        with ExitStack() as stack:
            yield {
                name: stack.enter_context(write_atomically(Path(folder) / name)) for name in names
            }
    except OSError as reason:
        raise ConfigurationError(
            f'{folder}: {what} cannot be written ({reason.strerror}): make room there, or name '
            'another folder'
        ) from None


def write_texts(folder: str | os.PathLike[str], texts: Mapping[str, str], what: str) -> None:
    """Write texts, as of `write_all_atomically`, into files by their names."""
    with write_all_atomically(folder, texts, what) as temporary:
        for name, text in texts.items():
            temporary[name].write_text(text, encoding='utf-8', errors='backslashreplace')
