"""A video file stands for the camera: it is read alike, and its end is like an unplugged cable."""

from __future__ import annotations

import contextlib
import functools
import threading
import time

import cv2
import numpy as np
import pytest

from ftp_dent_ros.capture.device import (
    CameraSettings,
    DeviceSource,
    V4l2Capture,
    _Due,
    open_device,
)
from ftp_dent_ros.capture.source import ExposureClock, stamps_exposure_start
from ftp_dent_ros.errors import CameraError, ConfigurationError


def write_video(path, levels):
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*'MJPG'), 30, (64, 48))
    for level in levels:
        writer.write(np.full((48, 64, 3), (10, 20, level), np.uint8))
    writer.release()


class RealTime:
    """A file that gives its frames at a camera's pace (subclasses of VideoCapture crash)."""

    def __init__(self, path, seen=None):
        self._capture, self._seen = cv2.VideoCapture(path), seen
        self._grabbed = 0

    def __getattr__(self, name):
        return getattr(self._capture, name)

    def grab(self):
        time.sleep(0.005)
        if self._grabbed and self._seen is not None:
            assert self._seen.wait(60)
        self._grabbed += 1
        return self._capture.grab()


@pytest.fixture
def camera(tmp_path):
    """Function that makes a source of a file, which may appear later."""
    sources = []

    def plug(rate=1e6, capture=cv2.VideoCapture):
        path = tmp_path / 'camera.avi'

        def open_capture():
            if not path.exists():
                raise CameraError(f'{path} does not exist: plug the camera in')
            return V4l2Capture(capture(str(path)))

        made = DeviceSource(open_capture, rate, ExposureClock(), time.time_ns, pause=0.02)
        sources.append(made)
        return made

    yield plug
    for made in sources:
        made.close()


def frames_until_unplugged(source, seen=None):
    """What it gives, which goes on once the first has been taken; and why it ends."""
    frames = []
    while True:
        try:
            frame = source.next_frame(5.0)
        except CameraError as error:
            return frames, str(error)
        assert frame is not None
        frames.append(frame)
        if seen is not None:
            seen.set()


def frame_in_spite_of_trouble(source):
    end = time.monotonic() + 60
    while time.monotonic() < end:
        with contextlib.suppress(CameraError):
            if frame := source.next_frame(0.1):
                return frame
    return None


def test_frames_are_new_and_in_order_until_the_camera_is_gone(tmp_path, camera):
    write_video(tmp_path / 'camera.avi', range(40, 240, 4))
    seen = threading.Event()
    source = camera(capture=functools.partial(RealTime, seen=seen))
    frames, trouble = frames_until_unplugged(source, seen)
    stamps = [frame.stamp_ns for frame in frames]
    levels = [int(frame.photograph.shown()[0, 0, 0]) for frame in frames]
    assert len(frames) > 0
    assert stamps == sorted(set(stamps)) and abs(stamps[0] - time.time_ns()) < 60e9
    assert levels == sorted(levels), 'no old frame comes after a newer one'
    assert frames[0].photograph.shown()[0, 0, 2] < 20, 'RGB, not BGR'
    assert trouble == 'the camera has stopped giving images: check its cable'


def test_a_camera_that_is_plugged_in_later_and_one_that_comes_back_are_opened(tmp_path, camera):
    source = camera()
    with pytest.raises(CameraError, match='plug the camera in'):
        while True:
            source.next_frame(1.0)
    write_video(tmp_path / 'other.avi', range(40, 240, 50))
    (tmp_path / 'other.avi').rename(tmp_path / 'camera.avi')
    assert frame_in_spite_of_trouble(source) is not None
    with pytest.raises(CameraError, match='stopped'):
        while True:
            source.next_frame(0.0)
    assert frame_in_spite_of_trouble(source) is not None
    assert source.notes()['times opened'] >= 2


def test_a_repeated_image_is_left_out(tmp_path, camera):
    write_video(tmp_path / 'camera.avi', [50] * 20)
    source = camera()
    frames, _ = frames_until_unplugged(source)
    assert len(frames) <= 1
    assert source.notes()['repeated images left out'] >= 19


def test_a_frame_on_demand_is_exposed_after_the_demand(tmp_path, camera):
    write_video(tmp_path / 'camera.avi', list(range(40, 240)) * 5)
    source = camera(rate=0.0, capture=RealTime)
    assert source.next_frame(0.05) is None, 'none is due without a rate'
    for _ in range(3):
        before = time.time_ns()
        assert source.shoot().stamp_ns >= before


def test_a_demand_is_met_by_a_camera_that_has_come_back(tmp_path, camera):
    write_video(tmp_path / 'short.avi', [40, 80])
    write_video(tmp_path / 'long.avi', list(range(40, 240)) * 5)
    (tmp_path / 'short.avi').rename(tmp_path / 'camera.avi')
    source = camera(rate=0.0, capture=RealTime)
    with pytest.raises(CameraError, match='stopped'):
        while True:
            source.next_frame(0.1)
    (tmp_path / 'long.avi').rename(tmp_path / 'camera.avi')
    opened = source.notes()['times opened']
    frame = None
    while frame is None:
        with contextlib.suppress(CameraError):
            frame = source.shoot()
    assert source.notes()['times opened'] > opened


def due_frames(rate, interval_ns, count, jitter=0):
    due = _Due(rate)
    rng = np.random.default_rng(1)
    stamps = [n * interval_ns + int(rng.integers(-jitter, jitter + 1)) for n in range(1, count)]
    return [n for n, stamp in enumerate(stamps) if due.at(stamp)]


@pytest.mark.parametrize('drift', [0.97, 1.0, 1.03])
def test_a_camera_at_the_rate_loses_no_frame(drift):
    assert len(due_frames(30.0, int(drift * 1e9 / 30), 301, jitter=3_000_000)) >= 291


def test_a_faster_camera_is_thinned_regularly():
    chosen = due_frames(10.0, int(1e9 / 30), 301, jitter=2_000_000)
    assert len(chosen) == 100
    assert set(np.diff(chosen)) == {3}


def test_a_missing_device_is_named():
    with pytest.raises(CameraError, match='/dev/video99 does not exist: plug'):
        open_device(CameraSettings(path='/dev/video99', width=1280, height=720))


def test_a_file_that_is_no_camera_is_refused(tmp_path):
    path = tmp_path / 'video0'
    path.write_bytes(bytes(100))
    with pytest.raises(CameraError, match='cannot be opened as a camera'):
        open_device(CameraSettings(path=str(path), width=1280, height=720))


@pytest.mark.parametrize('fourcc', ['MJPEG', 'ÄÖÜß', 'NV12'])
def test_a_pixel_format_that_cannot_serve_is_refused(fourcc):
    with pytest.raises(ConfigurationError, match='pixel format'):
        CameraSettings(path='/dev/video0', fourcc=fourcc)


MONOTONIC = 5_000_000_000_000
ROS = 1_763_000_000_000_000_000
MILLISECOND = 1_000_000


@pytest.mark.parametrize(
    ('clock', 'middle_ms'),
    [
        (ExposureClock(), -30),
        (ExposureClock(exposure=0.010), -35),
        (ExposureClock(exposure=0.010, at_start=True), -25),
        (ExposureClock(exposure=0.010, at_start=True, offset=-0.002), -27),
    ],
)
def test_a_buffer_is_stamped_with_the_middle_of_its_exposure(clock, middle_ms):
    buffer_ms = MONOTONIC / 1e6 - 30
    stamp, from_kernel = clock.stamp_ns(buffer_ms, MONOTONIC, ROS)
    assert from_kernel and abs(stamp - (ROS + middle_ms * MILLISECOND)) < 1000


@pytest.mark.parametrize(
    'buffer_ms',
    [0.0, 33.4, MONOTONIC / 1e6 - 1500, MONOTONIC / 1e6 + 40, ROS / 1e6, -1.0],
)
def test_an_implausible_time_is_not_believed(buffer_ms):
    clock = ExposureClock(exposure=0.010, at_start=True)
    assert clock.stamp_ns(buffer_ms, MONOTONIC, ROS) == (ROS - 5 * MILLISECOND, False)


def test_a_device_without_a_driver_stamps_the_end():
    assert not stamps_exposure_start('/dev/video99')
