"""The pattern in a window of a real X server, read back out of its frame buffer."""

from __future__ import annotations

import contextlib
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


@pytest.fixture
def compositor(tmp_path):
    """Starts a Wayland compositor of 320x240 at a scale; its environment."""
    if not (shutil.which('weston') and shutil.which('weston-screenshooter')):
        pytest.skip('weston is not installed: the window is not tested under Wayland')
    pytest.importorskip('sdl2', reason='SDL 2 is not installed: the window is not tested')
    running = []

    def begin(scale):
        tmp_path.chmod(0o700)
        settings = tmp_path / 'weston.ini'
        settings.write_text('[core]\nidle-time=0\n[shell]\npanel-position=none\nlocking=false\n')
        command = ['weston', '--backend=headless-backend.so', '--use-pixman', '--debug']
        command += ['--width=320', '--height=240', f'--scale={scale}', '--socket=wayland-test']
        environment = {**os.environ, 'XDG_RUNTIME_DIR': str(tmp_path)}
        for name in ('DISPLAY', 'WAYLAND_DISPLAY'):
            environment.pop(name, None)
        running.append(
            subprocess.Popen(
                [*command, f'--config={settings}'],
                env=environment,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
        )
        wait_for(lambda: (tmp_path / 'wayland-test').exists() or running[-1].poll() is not None)
        if running[-1].poll() is not None:
            pytest.skip('weston does not start here: the window is not tested under Wayland')
        return {
            **environment,
            'WAYLAND_DISPLAY': 'wayland-test',
            'SDL_VIDEODRIVER': 'wayland',
        }

    yield begin
    for process in running:
        process.terminate()
        process.wait()


@contextlib.contextmanager
def shown(environment, width=320):
    """A process that shows the pattern; what it says of its trouble can be read."""
    with subprocess.Popen(
        [sys.executable, '-c', SHOW.format(width=width)],
        env=environment,
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        try:
            yield process
        finally:
            process.kill()


def on_x11(name):
    environment = {**os.environ, 'DISPLAY': name, 'SDL_VIDEODRIVER': 'x11'}
    environment.pop('WAYLAND_DISPLAY', None)
    return environment


def wait_for(condition, seconds=60.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, 'not reached'
        time.sleep(0.05)


def test_a_screenshot_is_the_pattern_bit_for_bit(server):
    name, pixels = server
    with shown(on_x11(name)) as process:
        assert process.stdout.readline() == '\n'
        wait_for(lambda: (pixels() == PATTERN.draw()).all())


def test_another_resolution_is_told(server):
    with shown(on_x11(server[0]), width=400) as process:
        said = process.stdout.readline()
    assert 'the display shows 320x240 pixels, the pattern has 400x240' in said


def test_a_scaled_desktop_is_told(compositor):
    with shown(compositor(scale=2)) as process:
        assert 'set the scale of the desktop to 100 %' in process.stdout.readline()


def test_without_a_display_it_says_what_to_do(monkeypatch):
    pytest.importorskip('sdl2', reason='SDL 2 is not installed: the window is not tested')
    for name in ('DISPLAY', 'WAYLAND_DISPLAY'):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv('SDL_VIDEODRIVER', 'x11')
    with pytest.raises(ConfigurationError, match='there is no display'):
        Window(0, 0, (320, 240))
