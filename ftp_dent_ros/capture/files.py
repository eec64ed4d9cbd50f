"""Images from files: a folder, a pattern of names, or a video."""

from __future__ import annotations

import glob
from collections.abc import Callable, Iterator
from contextlib import suppress
from itertools import repeat
from pathlib import Path

import cv2
from numpy.typing import NDArray

from ftp_dent_ros.capture.source import Frame, PacedSource
from ftp_dent_ros.errors import ConfigurationError, ImageError
from ftp_dent_ros.files import by_number
from ftp_dent_ros.photograph.file import photograph_of_bgr
from ftp_dent_ros.photograph.photograph import Encoding

_PICTURES = ('.bmp', '.jpeg', '.jpg', '.png', '.pnm', '.ppm', '.tif', '.tiff', '.webp')


class FileSource(PacedSource):
    """Images of files, one after the other, stamped with the time at which they are read.

    Parameters
    ----------
    path : str
        A folder (its images in the order of their names, numbers by their value), a pattern of
        names with ``*``, ``?`` or ``[]``, an image, or a video.
    rate : float
        Images a second; 0 for none unless asked for.
    loop : bool
        Whether the first image follows the last.
    size : (int, int), optional
        Width and height that every image must have.
    now_ns : callable
        Time of a frame, nanoseconds of ROS time.
    encoding : str
        Of images, as `photograph_file.read_photograph` takes it.

    Raises
    ------
    ConfigurationError
        There is no such file, no image among them, or no such encoding.
    ImageError
        From `next_frame` and `shoot`: a file is no image or has the wrong size; the one after it
        comes next.
    """

    def __init__(
        self,
        path: str,
        rate: float,
        loop: bool,
        size: tuple[int, int] | None,
        now_ns: Callable[[], int],
        encoding: str = '',
    ) -> None:
        super().__init__(rate)
        if encoding:
            Encoding.named(encoding)
        self._encoding = encoding
        self._paths = find_images(path)
        self._loop = loop
        self._size = size
        self._now_ns = now_ns
        self._images = self._read()

    def shoot(self) -> Frame | None:
        """Next image at once; None after the last."""
        following = next(self._images, None)
        if following is None:
            self.finished = True
            return None
        path, image = following
        if image is None:
            raise ImageError(f'{path}: not an image that can be read: remove or replace it')
        height, width = image.shape[:2]
        if self._size and (width, height) != self._size:
            raise ImageError(
                f'{path}: has {width}x{height} pixels, the camera of the rig '
                f'{self._size[0]}x{self._size[1]}: use the images of this rig'
            )
        return Frame(photograph_of_bgr(image, self._encoding, str(path)), self._now_ns())

    def _read(self) -> Iterator[tuple[Path, NDArray | None]]:
        """Paths and their images, grey or BGR, None where a file cannot be read."""
        for paths in repeat(self._paths) if self._loop else [self._paths]:
            for path in paths:
                yield from _picture(path) if path.suffix.lower() in _PICTURES else _video(path)


def find_images(path: str) -> list[Path]:
    """Files that `path` names: see `FileSource`.

    Raises
    ------
    ConfigurationError
        There is none.
    """
    if not path:
        raise ConfigurationError(
            'no image files are named: give a folder, a pattern of names, or a video'
        )
    given = Path(path).expanduser()
    if given.is_dir():
        found = [item for item in given.iterdir() if item.suffix.lower() in _PICTURES]
    elif given.is_file():
        found = [given]
    else:
        found = [Path(item) for item in glob.glob(str(given), recursive=True)]
        found = [item for item in found if item.is_file()]
    if not found:
        raise ConfigurationError(
            f'{path}: no image there (of {", ".join(_PICTURES)}) and no video: check the path'
        )
    return sorted(found, key=by_number)


def _picture(path: Path) -> Iterator[tuple[Path, NDArray | None]]:
    image = None
    with suppress(cv2.error):
        image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    yield path, image


def _video(path: Path) -> Iterator[tuple[Path, NDArray | None]]:
    capture = cv2.VideoCapture(str(path))
    try:
        good, image = capture.read()
        if not good:
            yield path, None
        while good:
            yield path, image
            good, image = capture.read()
    finally:
        capture.release()
