"""A calibration's folder: what was projected on which board, and the folders of its poses."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import yaml

from ftp_dent_ros.calibration.boards.board import Board
from ftp_dent_ros.calibration.observing.observing import Sight, observe
from ftp_dent_ros.calibration.observing.photographs import find_poses, read_pose
from ftp_dent_ros.calibration.observing.sequence import Sequence
from ftp_dent_ros.errors import CalibrationError, ConfigurationError
from ftp_dent_ros.files import written_aside
from ftp_dent_ros.yaml_file import read_yaml

FILE = 'calibration.yaml'


@dataclass(frozen=True)
class Session:
    """What all poses of a calibration have in common.

    Attributes
    ----------
    board : Board
    sequence : Sequence
    baseline : float
        Distance between the lenses by the tape, metres; 0 if it was not measured.
    delay : float
        From the message to the projector's light, seconds, as measured.
    gamma : float
        Exponent of the projector's light over its grey level; 0 if it is not known.
    """

    board: Board
    sequence: Sequence
    baseline: float = 0.0
    delay: float = 0.0
    gamma: float = 0.0


def write_session(folder: Path, session: Session) -> None:
    """Write ``calibration.yaml`` into a folder."""
    with written_aside(folder / FILE) as aside:
        aside.write_text(yaml.safe_dump(asdict(session), sort_keys=False), encoding='utf-8')


def read_session(folder: Path) -> Session:
    """Read a folder's ``calibration.yaml``; raises `ConfigurationError` with what is wrong."""
    path = folder / FILE
    data = read_yaml(path, ConfigurationError)
    board = _made(Board, data.get('board'), f'{path}: board')
    sequence = _made(Sequence, data.get('sequence'), f'{path}: sequence')
    numbers = []
    for name in ('baseline', 'delay', 'gamma'):
        value = data.get(name, 0.0)
        number = isinstance(value, (int, float)) and not isinstance(value, bool)
        if not number or not 0 <= value < math.inf:
            raise ConfigurationError(f'{path}: {name} is {value!r}: give a number, or 0')
        numbers.append(float(value))
    return Session(board, sequence, *numbers)


def see_poses(
    folder: Path, session: Session, progress: Callable[[str], None] = lambda name: None
) -> tuple[list[Sight], list[str], tuple[int, int]]:
    """Read all poses of a folder.

    Returns
    -------
    sights : list of Sight
    left_out : list of str
        A sentence for each pose that cannot be used.
    size : (int, int)
        Width and height of the photographs.

    Raises
    ------
    CalibrationError
        No pose can be used, or their photographs have different sizes.
    """
    sights: list[Sight] = []
    left_out: list[str] = []
    sizes: dict[tuple[int, int], str] = {}
    for pose in find_poses(folder):
        try:
            taken = read_pose(pose, session.sequence)
            height, width = next(iter(taken.values())).shape
            sizes.setdefault((width, height), pose.name)
            sights.append(observe(pose.name, taken, session.sequence, session.board))
        except CalibrationError as reason:
            there, all_of_it = len(pose.files), len(session.sequence.frames)
            few = f' ({there} of the {all_of_it} photographs are there)'
            left_out.append(f'{reason}{few if there < all_of_it else ""}')
        progress(pose.name)
    if len(sizes) > 1:
        listed = ', '.join(f'{w}x{h} ({name})' for (w, h), name in sizes.items())
        raise CalibrationError(f'{folder}: photographs of different sizes: {listed}')
    if not sights:
        raise CalibrationError(
            f'{folder}: none of {len(left_out)} poses can be used; the first: {left_out[0]}'
        )
    return sights, left_out, next(iter(sizes))


def _made(kind: Any, fields: Any, where: str) -> Any:
    if not isinstance(fields, dict):
        raise ConfigurationError(f'{where} is missing: add it')
    try:
        return kind(**fields)
    except TypeError as reason:
        raise ConfigurationError(f'{where}: {reason}: correct it') from None
