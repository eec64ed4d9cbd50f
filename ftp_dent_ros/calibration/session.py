"""A calibration's folder: what was projected on which board, and the photographs of each pose."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml
from numpy.typing import NDArray

from ftp_dent_ros.calibration.board import Board
from ftp_dent_ros.calibration.observing import BoardSight, observe
from ftp_dent_ros.calibration.sequence import ProjectedFrame, Sequence
from ftp_dent_ros.errors import CalibrationError, ConfigurationError, ImageError
from ftp_dent_ros.fields import Checked, Fields, NotNegative
from ftp_dent_ros.files import by_number, write_atomically
from ftp_dent_ros.photograph.file import is_photograph, read_photograph
from ftp_dent_ros.yaml_file import read_yaml

FILE = 'calibration.yaml'


def find_poses(folder: Path) -> dict[str, dict[int, Path]]:
    """The photographs of each pose by the number that their names end in, by the pose's name.

    Raises
    ------
    CalibrationError
        There are no poses below the folder, or their files cannot be put in order.
    """
    if not folder.is_dir():
        raise CalibrationError(f'{folder}: no such folder: give the one that holds the poses')
    poses = {}
    for below in sorted(filter(Path.is_dir, folder.iterdir()), key=by_number):
        files = [path for path in below.iterdir() if is_photograph(path)]
        # A name with a dot was being written when a capture was killed.
        if files and not below.name.startswith('.'):
            poses[below.name] = _numbered(below, sorted(files, key=by_number))
    if not poses:
        raise CalibrationError(
            f'{folder}: holds no folders with photographs: put those of each pose into one of '
            'its own (pose_0, pose_1, ...)'
        )
    return poses


def _numbered(folder: Path, files: list[Path]) -> dict[int, Path]:
    found: dict[int, Path] = {}
    for path in files:
        number = re.search(r'(\d+)$', path.stem)
        if number is None:
            raise CalibrationError(
                f'{path}: the name does not end in a number: number the photographs of a pose in '
                'the order in which they were projected'
            )
        found[int(number[1])] = path
    if len(found) < len(files):
        raise CalibrationError(f'{folder}: two photographs have the same number: keep one of each')
    return found


def read_pose(
    files: dict[int, Path], sequence: Sequence, first: int = 0
) -> dict[ProjectedFrame, NDArray[np.uint8]]:
    """Grey photographs of a pose by the frame that was projected.

    Of more than 8 bits, all are divided by what the brightest photograph needs.

    Raises
    ------
    CalibrationError
        The sizes differ, or there are not as many files as frames.
    ImageError
        A file is damaged.
    """
    frames = sequence.frames
    if sorted(files) != list(range(first, first + len(frames))):
        raise CalibrationError(
            f'has {len(files)} photographs, up to number {max(files)}, and the sequence '
            f'of a {sequence.width}x{sequence.height} projector {len(frames)}: check the '
            "projector's size and the sequence, and that no photograph is missing"
        )
    levels = [_grey(files[number]) for number in sorted(files)]
    sizes = {image.shape for image in levels}
    if len(sizes) > 1:
        raise CalibrationError(f'the photographs have {len(sizes)} different sizes')
    shift = max(0, *(int(image.max()).bit_length() - 8 for image in levels))
    taken = {f: (image >> shift).astype(np.uint8) for f, image in zip(frames, levels, strict=True)}
    white, black = ProjectedFrame('white'), ProjectedFrame('black')
    # Tools differ in which of the two comes first.
    if taken[white].mean() < taken[black].mean():
        taken[white], taken[black] = taken[black], taken[white]
    return taken


def _grey(path: Path) -> NDArray[Any]:
    image = read_photograph(path)
    return image.pixels if image.is_flat else cv2.cvtColor(image.pixels, cv2.COLOR_RGB2GRAY)


@dataclass(frozen=True)
class Session(Checked):
    """What all poses of a calibration have in common.

    Attributes
    ----------
    board : Board
    sequence : Sequence
    baseline : float
        Distance between the lenses by the tape, metres; 0 if it was not measured.
    delay : float
        From the message to the projector's light, seconds, as measured.
    """

    board: Board
    sequence: Sequence
    baseline: NotNegative = 0.0
    delay: NotNegative = 0.0


def write_session(folder: Path, session: Session) -> None:
    """Write ``calibration.yaml`` into a folder."""
    with write_atomically(folder / FILE) as temporary:
        temporary.write_text(yaml.safe_dump(asdict(session), sort_keys=False), encoding='utf-8')


def read_session(folder: Path) -> Session:
    """Read a folder's ``calibration.yaml``; raises `ConfigurationError` with what is wrong."""
    path = folder / FILE
    return Fields(read_yaml(path, ConfigurationError), f'{path}: ').record(Session)


def see_poses(
    folder: Path, session: Session, progress: Callable[[], object] = lambda: None
) -> tuple[list[BoardSight], list[str], tuple[int, int]]:
    """Read all poses of a folder.

    Returns
    -------
    sights : list of BoardSight
    left_out : list of str
        A sentence for each pose that cannot be used.
    size : (int, int)
        Width and height of the photographs.

    Raises
    ------
    CalibrationError
        No pose can be used, or their photographs have different sizes.
    """
    sights: list[BoardSight] = []
    left_out: list[str] = []
    sizes: dict[tuple[int, int], str] = {}
    poses = find_poses(folder)
    first = min(number for files in poses.values() for number in files)
    for name, files in poses.items():
        try:
            taken = read_pose(files, session.sequence, first)
            height, width = next(iter(taken.values())).shape
            sizes.setdefault((width, height), name)
            sights.append(observe(name, taken, session.sequence, session.board))
        except (CalibrationError, ImageError) as reason:
            left_out.append(f'{name}: {reason}')
        progress()
    if len(sizes) > 1:
        listed = ', '.join(f'{w}x{h} ({name})' for (w, h), name in sizes.items())
        raise CalibrationError(f'{folder}: photographs of different sizes: {listed}')
    if not sights:
        raise CalibrationError(
            f'{folder}: none of {len(left_out)} poses can be used; the first: {left_out[0]}'
        )
    return sights, left_out, next(iter(sizes))
