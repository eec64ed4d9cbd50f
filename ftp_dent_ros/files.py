"""Where the package's shared files are, and how a file is written without leaving halves."""

from __future__ import annotations

import errno
import hashlib
import math
import os
import tempfile
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from ftp_dent_ros.errors import ConfigurationError, InputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

#: What the name of a file of the package begins with.
SHIPPED = 'shipped:'
# A bag's metadata with a thousand topics has a megabyte. With its aliases written out a file may
# hold so many values, so that an error message of one of them stays small.
_LARGEST_YAML = 1 << 22
_MOST_VALUES = 1_000_000


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
        return _find_shipped(text.removeprefix(SHIPPED))
    path = Path(text).expanduser()
    if path.exists():
        return path
    where = '' if path.is_absolute() else f' in {Path.cwd()}'
    advice = 'check the path'
    if (config_folder() / path.name).is_file():
        advice += f', or give {SHIPPED}{path.name} for the example that is shipped'
    raise ConfigurationError(f'{path}: no such file{where}: {advice}')


def _find_shipped(name: str) -> Path:
    names = sorted(path.name for path in config_folder().iterdir() if path.is_file())
    if name not in names:
        raise ConfigurationError(
            f'{SHIPPED}{name}: no file of that name is shipped: give one of {", ".join(names)}'
        )
    return config_folder() / name


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


def read_yaml(path: str | os.PathLike[str], error: type[InputError]) -> dict[str, Any]:
    """Mapping in a YAML file; `error` is raised, with the line, if it is no plain data.

    All keys are texts and whole numbers have 64 bits, as ROS has them.
    """
    try:
        with Path(path).open('rb') as file:
            text = file.read(_LARGEST_YAML + 1).decode('utf-8')
    except OSError as reason:
        raise error(f'{path}: cannot be read ({reason.strerror}): check the path') from None
    except UnicodeDecodeError:
        raise error(f'{path}: cannot be read (not text in UTF-8): check the path') from None
    if len(text) > _LARGEST_YAML:
        raise error(f'{path}: larger than {_LARGEST_YAML >> 20} MB: give a file of settings')
    try:
        data = yaml.load(text, _PlainLoader)
    except RecursionError:
        raise error(f'{path}: not valid YAML (nested too deeply): correct the file') from None
    except yaml.YAMLError as reason:
        where = getattr(reason, 'problem_mark', None)
        line = f' in line {where.line + 1}' if where else ''
        what = getattr(reason, 'problem', None)
        said = f' ({what})' if what else ''
        raise error(f'{path}: not valid YAML{line}{said}: correct the file') from None
    if not isinstance(data, dict):
        raise error(f'{path}: holds no mapping of fields: correct the file')
    return data


class _PlainLoader(yaml.SafeLoader):
    """Refuses what a file of settings cannot mean, and says in which line."""

    def get_single_data(self) -> Any:
        node = self.get_single_node()
        if node is None:
            return None
        if _size(node, {}) > _MOST_VALUES:
            raise self._refusal(node, 'its aliases repeat more than can be meant')
        return self.construct_document(node)

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        try:
            value = super().construct_object(node, deep)
        except (yaml.YAMLError, RecursionError):
            raise
        except Exception as reason:  # what a date, a number or a tag out of place makes of it
            kind = node.tag.rpartition(':')[2]
            what = (
                f'{node.value!r:.40} is no {kind}' if isinstance(node.value, str) else str(reason)
            )
            raise self._refusal(node, what) from None
        if isinstance(value, int) and not -(1 << 63) <= value < 1 << 64:
            raise self._refusal(node, 'a number of more than 64 bits')
        return value

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        names = Counter(key.value for key, _ in node.value if isinstance(key, yaml.ScalarNode))
        for name, times in names.most_common(1):
            if times > 1:
                raise self._refusal(node, f'{name!r:.40} is there {times} times')
        mapping = super().construct_mapping(node, deep)
        for key in mapping:
            if not isinstance(key, str):
                raise self._refusal(node, f'the key {key!r} is no text: put it in quotes')
        return mapping

    def _refusal(self, node: yaml.Node, problem: str) -> yaml.YAMLError:
        return yaml.constructor.ConstructorError(None, None, problem, node.start_mark)


def _size(node: yaml.Node, known: dict[int, float]) -> float:
    """Number of values below a node, those of aliases each time; infinite if it holds itself."""
    size = known.get(id(node))
    if size is None:
        known[id(node)] = math.inf
        parts = node.value if isinstance(node, yaml.CollectionNode) else ()
        if isinstance(node, yaml.MappingNode):
            parts = [each for pair in parts for each in pair]
        size = known[id(node)] = 1 + sum(_size(each, known) for each in parts)
    return size


def write_png(path: str | os.PathLike[str], image: NDArray[Any]) -> None:
    """Write an image as OpenCV has it (grey, BGR or BGRA) as PNG; the file is whole or not there.

    Raises
    ------
    InputError
        The file cannot be written.
    """
    # Taken only here: most of what reads and writes files has no images.
    import cv2

    done, data = cv2.imencode('.png', image)
    try:
        with written_aside(path) as aside:
            aside.write_bytes(data.tobytes() if done else b'')
    except OSError as reason:
        raise InputError(
            f'{path}: cannot be written ({reason.strerror}): check the path'
        ) from None


def check_writable(path: str | os.PathLike[str]) -> None:
    """Raise `ConfigurationError`, before minutes of work, if a file cannot be written."""
    if why := why_not_writable(path):
        raise ConfigurationError(f'{path}: cannot be written ({why}): give another place')


def why_not_writable(path: str | os.PathLike[str]) -> str:
    """Why a file cannot be written, or a folder has its name; empty if it can.

    Nothing is left of the trial.
    """
    if Path(path).is_dir():
        return os.strerror(errno.EISDIR)
    try:
        with tempfile.TemporaryFile(dir=nearest_folder(path)):
            return ''
    except OSError as reason:
        return str(reason.strerror)


def nearest_folder(path: str | os.PathLike[str]) -> Path:
    """What of the folders above a file is there: the file is going to be on its disk."""
    return next(each for each in Path(path).absolute().parents if each.exists())


@contextmanager
def written_aside(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary path beside `path` that takes its name only if all went well.

    Raises
    ------
    OSError
        It cannot be written; `filename` is `path`.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    aside = path.with_name(f'.{path.stem}.{os.getpid()}{path.suffix}')
    try:
        yield aside
        os.replace(aside, path)
    except OSError as reason:
        # A full disk names no file, and nobody knows the one aside.
        if reason.filename in (None, str(aside), aside):
            reason.filename, reason.filename2 = str(path), None
        raise
    finally:
        aside.unlink(missing_ok=True)
