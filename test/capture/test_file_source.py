from __future__ import annotations

from itertools import count

import cv2
import numpy as np
import pytest

from ftp_dent_ros.capture.source import FileSource, find_images
from ftp_dent_ros.errors import ConfigurationError, ImageError

SIZE = (64, 48)


def picture(level: int, size: tuple[int, int] = SIZE) -> np.ndarray:
    """BGR image whose red is `level`."""
    return np.full((size[1], size[0], 3), (10, 20, level), np.uint8)


@pytest.fixture
def folder(tmp_path):
    for number in (10, 2, 1):
        cv2.imwrite(str(tmp_path / f'shot{number}.png'), picture(number))
    (tmp_path / 'notes.txt').write_text('not an image')
    return tmp_path


def source(path, loop=False, rate=0.0, size=SIZE) -> FileSource:
    return FileSource(str(path), rate, loop, size, count(1000).__next__)


def reds(files: FileSource, times: int) -> list[int | None]:
    frames = [files.shoot() for _ in range(times)]
    return [None if frame is None else int(frame.photograph.pixels[0, 0, 0]) for frame in frames]


def test_a_folder_is_read_in_the_order_of_its_numbers(folder):
    files = source(folder)
    assert reds(files, 5) == [1, 2, 10, None, None]
    assert files.finished
    assert reds(source(folder / 'shot1*.png'), 3) == [1, 10, None], 'a pattern of names chooses'


def test_a_grey_or_deep_image_is_taken_as_rgb(tmp_path):
    cv2.imwrite(str(tmp_path / 'a.png'), np.full((48, 64), 70, np.uint8))
    cv2.imwrite(str(tmp_path / 'b.png'), np.full((48, 64, 3), 70 * 257, np.uint16))
    cv2.imwrite(str(tmp_path / 'c.png'), np.full((48, 64, 4), 70, np.uint8))
    for frame in (files := source(tmp_path)).shoot(), files.shoot(), files.shoot():
        assert frame is not None and np.unique(frame.photograph.shown()).tolist() == [70]


def test_a_video_is_read_frame_by_frame_and_again(tmp_path):
    levels = [40, 80, 120, 160]
    writer = cv2.VideoWriter(
        str(tmp_path / 'flight.avi'), cv2.VideoWriter.fourcc(*'MJPG'), 30, SIZE
    )
    for level in levels:
        writer.write(picture(level))
    writer.release()
    files = source(tmp_path / 'flight.avi', loop=True)
    np.testing.assert_allclose(reds(files, 8), levels * 2, atol=6)
    (tmp_path / 'flight.mp4').write_bytes(bytes(1000))
    with pytest.raises(ImageError, match=r'flight\.mp4: not a photograph'):
        source(tmp_path / 'flight.mp4').shoot()


def test_wrong_files_are_refused_by_name_and_the_next_one_comes(folder):
    (folder / 'shot3.png').write_bytes(b'not a png')
    (folder / 'shot4.png').write_bytes(b'')
    cv2.imwrite(str(folder / 'shot5.png'), picture(5, (32, 24)))
    files = source(folder)
    assert reds(files, 2) == [1, 2]
    for name, sentence in [
        ('shot3', 'not an image'),
        ('shot4', 'not an image'),
        ('shot5', 'has 32x24 pixels, the camera of the rig 64x48'),
    ]:
        with pytest.raises(ImageError, match=f'{name}.*{sentence}'):
            files.shoot()
    assert reds(files, 2) == [10, None]


@pytest.mark.parametrize('path', ['', 'nothing', 'empty', 'empty/*.png', '[', '/dev/null/x'])
def test_a_path_without_images_is_refused(tmp_path, path):
    (tmp_path / 'empty').mkdir()
    given = str(tmp_path / path) if path and not path.startswith('/') else path
    with pytest.raises(ConfigurationError):
        find_images(given)


def test_frames_fall_due_at_the_rate(folder):
    files = source(folder, loop=True, rate=1000.0)
    assert files.next_frame(1.0) is not None
    assert files.next_frame(1.0) is not None
    slow = source(folder, loop=True, rate=0.001)
    assert slow.next_frame(0.0) is not None, 'the first is due at once'
    assert slow.next_frame(0.0) is None
    on_demand = source(folder)
    assert on_demand.next_frame(0.001) is None and on_demand.shoot() is not None
