"""Aravis's own fake GigE Vision camera, over the loopback."""

from __future__ import annotations

import contextlib
import ctypes
import fcntl
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pytest

from ftp_dent_ros.capture.aravis import SOFTWARE, GenicamCapture
from ftp_dent_ros.capture.device import CameraSettings, DeviceSource
from ftp_dent_ros.capture.source import ExposureClock
from ftp_dent_ros.errors import CameraError
from ftp_dent_ros.files import config_folder
from ftp_dent_ros.pattern.file import read_pattern
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.profilometry import Reconstructor, Settings
from ftp_dent_ros.rig.rig import read_rig
from ftp_dent_ros.simulation import Panel, Photometry, Surface, render

PROGRAM = 'arv-fake-gv-camera-0.8'


@pytest.fixture(scope='module', autouse=True)
def aravis():
    try:
        ctypes.CDLL('libaravis-0.8.so.0')
    except OSError:
        pytest.skip('Aravis is not installed (apt: aravis-tools): GenICam is not tested')
    if not shutil.which(PROGRAM):
        pytest.skip('aravis-tools is not installed: GenICam is not tested')
    # GigE Vision has one port: test runs of this machine take turns.
    with (Path(tempfile.gettempdir()) / 'ftp_dent_ros_aravis.lock').open('w') as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


@pytest.fixture
def fake():
    """Function that starts a fake camera; it serves the loopback alone."""
    started = []

    def start(*options):
        started.append(subprocess.Popen([PROGRAM, '-i', '127.0.0.1', '-s', 'FTP1', *options]))
        return started[-1]

    yield start
    for process in started:
        process.kill()
        process.wait()


def open_camera(seconds=120.0, **settings):
    """The camera, once it answers and gives frames: a client may come before it is ready."""
    end = time.monotonic() + seconds
    while True:
        with contextlib.suppress(CameraError):
            capture = GenicamCapture(CameraSettings(camera='Aravis-FTP1', **settings))
            if capture.grab():
                return capture
            capture.release()
        assert time.monotonic() < end, 'the fake camera does not answer'
        time.sleep(0.2)


@pytest.mark.parametrize('trigger', ['', SOFTWARE])
def test_frames_come_with_their_time(fake, trigger):
    fake()
    asked = {'exposure': 0.005, 'pixel_format': 'Mono8', 'trigger': trigger}
    capture = open_camera(width=256, height=128, device_rate=20.0, **asked)
    try:
        stamps = []
        for _ in range(4):
            assert capture.grab()
            image = capture.retrieve()
            assert image.encoding == 'mono8'
            assert image.pixels.shape == (128, 256) and image.pixels.std() > 0
            stamps.append(capture.get(0))
            assert abs(time.monotonic() * 1e3 - stamps[-1]) < 2000
        assert stamps == sorted(stamps)
        assert 0 <= float(capture.notes()['time stamp uncertainty (ms)']) < 500
    finally:
        capture.release()


def test_frames_with_lost_packets_are_dropped_and_told_and_a_lost_camera_comes_back(fake):
    process = fake('-r', '30')
    settings = CameraSettings(camera='Aravis-FTP1', width=512, height=512, device_rate=20.0)
    clock = ExposureClock(0.005, True, 0.0)
    source = DeviceSource(lambda: GenicamCapture(settings), 0.0, clock, time.time_ns, pause=0.1)

    def until(condition):
        end = time.monotonic() + 120
        while not condition():
            assert time.monotonic() < end, source.notes()
            time.sleep(0.05)

    try:
        until(lambda: source.notes().get('frames dropped for lost packets', 0) > 0)
        process.kill()
        process.wait()
        fake()
        until(lambda: source.notes()['times opened'] >= 2)

        def shot():
            try:
                return source.shoot()
            except CameraError:
                return None

        until(lambda: (frame := shot()) is not None and np.ptp(frame.photograph.shown()) > 0)
    finally:
        source.close()


def test_fringes_come_through_bit_for_bit_and_give_the_same_cloud(tmp_path):
    rig = read_rig(config_folder() / 'rig.yaml')
    pattern = read_pattern(config_folder() / 'pattern.yaml')
    wall = Surface((Panel(Pose.from_rpy((0.05, -0.1, 0), (0, 0, 0.8)), (-1, 1, -1, 1)),))
    pixels = render(rig, pattern.draw(), wall, Photometry(reference_distance=0.8))
    np.save(tmp_path / 'photograph.npy', pixels)
    program = Path(__file__).with_name('fake_genicam.py')
    command = [sys.executable, str(program), 'FTP1', str(tmp_path / 'photograph.npy')]
    with subprocess.Popen(command) as process:
        try:
            camera = rig.camera
            capture = open_camera(
                width=camera.width, height=camera.height, device_rate=10.0, pixel_format='RGB8'
            )
            image = capture.retrieve()
            capture.release()
        finally:
            process.kill()
    assert image.encoding == 'rgb8'
    np.testing.assert_array_equal(image.pixels, pixels)
    cloud = Reconstructor(rig, pattern, Settings(stride=8)).measure(image).cloud
    assert cloud.valid.mean() > 0.5
    assert np.abs(wall.distance(cloud.points[cloud.valid].astype(float))).mean() < 1e-4


def test_a_camera_that_is_not_there_is_told():
    with pytest.raises(CameraError, match=r'Aravis-NONE: .*check its cable'):
        GenicamCapture(CameraSettings(camera='Aravis-NONE'))
