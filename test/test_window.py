"""The pattern in a window of a real X server, read back out of its frame buffer."""

from __future__ import annotations

import os
import shutil
import struct
import subprocess
import sys
import time

import numpy as np
import pytest

from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.window import Window

PATTERN = Pattern(320, 240, 10.0, 150.0)
SHOW = """
import sys, time
from ftp_dent_ros.window import Window
from ftp_dent_ros.pattern.pattern import Pattern
window = Window(0, 0, ({width}, 240))
window.show(Pattern({width}, 240, 10.0, 150.0).draw())
print(window.trouble, flush=True)
while True:
    window.refresh()
    time.sleep(0.05)
"""


@pytest.fixture
def server(tmp_path):
    """Name of a display of 320x240 pixels, and a function that gives its pixels."""
    if not shutil.which('Xvfb'):
        pytest.skip('Xvfb is not installed: the window is not tested')
    pytest.importorskip('sdl2', reason='SDL 2 is not installed: the window is not tested')
    read_end, write_end = os.pipe()
    process = subprocess.Popen(
        ['Xvfb', '-displayfd', str(write_end), '-screen', '0', '320x240x24', '-fbdir', tmp_path],
        pass_fds=[write_end],
        stderr=subprocess.DEVNULL,
    )
    os.close(write_end)
    with os.fdopen(read_end) as pipe:
        name = ':' + pipe.readline().strip()

    def pixels():
        data = (tmp_path / 'Xvfb_screen0').read_bytes()
        # X window dump: 25 numbers, big-endian, then a name and colours before the pixels.
        header = struct.unpack('>25I', data[:100])
        start = header[0] + 12 * header[19]
        width, height, pitch = header[4], header[5], header[12]
        rows = np.frombuffer(data, np.uint8, pitch * height, start).reshape(height, pitch)
        return rows[:, : 4 * width].reshape(height, width, 4)[..., 2::-1]

    yield name, pixels
    process.terminate()
    process.wait()


def start(name, width=320):
    environment = {**os.environ, 'DISPLAY': name, 'SDL_VIDEODRIVER': 'x11'}
    environment.pop('WAYLAND_DISPLAY', None)
    return subprocess.Popen(
        [sys.executable, '-c', SHOW.format(width=width)],
        env=environment,
        stdout=subprocess.PIPE,
        text=True,
    )


def wait_for(condition, seconds=60.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, 'not reached'
        time.sleep(0.05)


def test_a_screenshot_is_the_pattern_bit_for_bit(server):
    name, pixels = server
    process = start(name)
    try:
        assert process.stdout.readline() == '\n'
        wait_for(lambda: (pixels() == PATTERN.draw()).all())
    finally:
        process.kill()
        process.wait()
        process.stdout.close()


def test_another_resolution_is_told(server):
    name, _ = server
    process = start(name, width=400)
    try:
        said = process.stdout.readline()
    finally:
        process.kill()
        process.wait()
        process.stdout.close()
    assert 'the display shows 320x240 pixels, the pattern has 400x240' in said


def test_without_a_display_it_says_what_to_do(monkeypatch):
    pytest.importorskip('sdl2', reason='SDL 2 is not installed: the window is not tested')
    for name in ('DISPLAY', 'WAYLAND_DISPLAY'):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv('SDL_VIDEODRIVER', 'x11')
    with pytest.raises(ConfigurationError, match='there is no display'):
        Window(0, 0, (320, 240))
