"""Folders of photographs, a folder a pose."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.calibration.observing.sequence import Frame, Sequence
from ftp_dent_ros.errors import CalibrationError

_GREY = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH
_SUFFIXES = ('.png', '.jpg', '.jpeg', '.tif', '.tiff', '.bmp')


@dataclass(frozen=True)
class PoseFolder:
    """The photographs of one pose, not read yet.

    Attributes
    ----------
    name : str
    files : dict of int to Path
        By the number that their names end in.
    """

    name: str
    files: dict[int, Path]


def find_poses(folder: Path) -> list[PoseFolder]:
    """The pose folders below a folder, in the order of their names.

    Raises
    ------
    CalibrationError
        There are none, or a folder's files cannot be put in order.
    """
    if not folder.is_dir():
        raise CalibrationError(f'{folder}: no such folder: give the one that holds the poses')
    poses = []
    for below in sorted(filter(Path.is_dir, folder.iterdir()), key=_natural):
        # What was being written when a capture was killed.
        if below.name.startswith('.'):
            continue
        files = sorted((p for p in below.iterdir() if p.suffix.lower() in _SUFFIXES), key=_natural)
        if files:
            poses.append(PoseFolder(below.name, _numbered(below, files)))
    if not poses:
        raise CalibrationError(
            f'{folder}: holds no folders with photographs: put those of each pose into one of '
            'its own (pose_0, pose_1, ...)'
        )
    first = min(min(pose.files) for pose in poses)
    return [
        PoseFolder(pose.name, {number - first: path for number, path in pose.files.items()})
        for pose in poses
    ]


def read_pose(pose: PoseFolder, sequence: Sequence) -> dict[Frame, NDArray[np.uint8]]:
    """Grey photographs of a pose by the frame that was projected; missing ones are left out.

    Raises
    ------
    CalibrationError
        A file is damaged, the sizes differ, or there are more files than frames.
    """
    frames = sequence.frames
    beyond = max(pose.files) + 1
    if beyond > len(frames):
        raise CalibrationError(
            f'{pose.name}: has a photograph number {beyond}, and the sequence of a '
            f'{sequence.width}x{sequence.height} projector only {len(frames)}: check the '
            "projector's size and the sequence"
        )
    levels: dict[Frame, NDArray[Any]] = {}
    for number, path in pose.files.items():
        data = np.fromfile(path, np.uint8)
        image = cv2.imdecode(data, _GREY) if len(data) else None
        if image is None:
            raise CalibrationError(f'{path}: empty, damaged or not an image: take the pose again')
        levels[frames[number]] = np.asarray(image)
    taken = _of_eight_bits(levels)
    sizes = {image.shape for image in taken.values()}
    if len(sizes) > 1:
        raise CalibrationError(f'{pose.name}: the photographs have {len(sizes)} different sizes')
    return in_order(taken)


def _of_eight_bits(levels: dict[Frame, NDArray[Any]]) -> dict[Frame, NDArray[np.uint8]]:
    """The same in 8 bits; of 16, all are divided by what the brightest photograph needs."""
    deep = [image for image in levels.values() if image.dtype == np.uint16]
    highest = max((int(image.max(initial=0)) for image in deep), default=0)
    shift = max(highest.bit_length() - 8, 0)
    return {
        frame: (image >> (shift if image.dtype == np.uint16 else 0)).astype(np.uint8)
        for frame, image in levels.items()
    }


def in_order(taken: dict[Frame, NDArray[np.uint8]]) -> dict[Frame, NDArray[np.uint8]]:
    """The same with white and black told apart: tools differ in which comes first."""
    white, black = Frame('white'), Frame('black')
    if white in taken and black in taken and taken[white].mean() < taken[black].mean():
        return taken | {white: taken[black], black: taken[white]}
    return taken


def _numbered(folder: Path, files: list[Path]) -> dict[int, Path]:
    numbers = [re.search(r'(\d+)$', path.stem) for path in files]
    if not all(numbers):
        named = next(path for path, number in zip(files, numbers, strict=True) if not number)
        raise CalibrationError(
            f'{named}: the name does not end in a number: number the photographs of a pose in '
            'the order in which they were projected'
        )
    found = {int(n.group(1)): p for n, p in zip(numbers, files, strict=True) if n}
    if len(found) < len(files):
        raise CalibrationError(f'{folder}: two photographs have the same number: keep one of each')
    return found


def _natural(path: Path) -> list[tuple[int, str]]:
    return [
        (int(part), '') if part.isdigit() else (-1, part) for part in re.split(r'(\d+)', path.name)
    ]
