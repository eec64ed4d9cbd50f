"""The pattern through the kernel's mode setting, against a recorded sequence of requests."""

from __future__ import annotations

import ctypes

import numpy as np
import pytest

from ftp_dent_ros.display import drm
from ftp_dent_ros.display.drm import DrmDisplay
from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.pattern.pattern import Pattern

# As strace prints them of `modetest` and of the kernel's own selftests on x86-64 and arm64.
REQUESTS = {
    'SET_MASTER': 0x641E,
    'GETRESOURCES': 0xC04064A0,
    'SETCRTC': 0xC06864A2,
    'GETENCODER': 0xC01464A6,
    'GETCONNECTOR': 0xC05064A7,
    'ADDFB': 0xC01C64AE,
    'RMFB': 0xC00464AF,
    'CREATE_DUMB': 0xC02064B2,
    'MAP_DUMB': 0xC01064B3,
    'DESTROY_DUMB': 0xC00464B4,
}
NAMES = {number: name for name, number in REQUESTS.items()}
PATTERN = Pattern(320, 240, 10.0, 150.0)
SIZE = PATTERN.width, PATTERN.height
PITCH = 4 * 320 + 64  # kernels round it up
HDMI = 11


class Kernel:
    """A card with an unused DP and an HDMI connector, as vkms and i915 answer."""

    def __init__(self, sizes=((1920, 1080), (320, 240)), plugged=True):
        self.sizes, self.plugged = sizes, plugged
        self.calls = []
        self.memory = bytearray(PITCH * 240)
        self.shown = None

    def ioctl(self, file, request, value):
        name = NAMES[request]
        self.calls.append(name)
        getattr(self, f'on_{name}')(value)

    def map(self, file, size, offset):
        assert (size, offset) == (len(self.memory), 0x1000)
        return self.memory

    def on_SET_MASTER(self, value):
        pass

    def on_GETRESOURCES(self, value):
        if value.connector_id_ptr:
            fill(value.connector_id_ptr, [10, HDMI])
            fill(value.crtc_id_ptr, [41, 42])
        value.count_connectors, value.count_crtcs = 2, 2
        value.count_encoders = value.count_fbs = 3

    def on_GETCONNECTOR(self, value):
        hdmi = value.connector_id == HDMI
        plugged = hdmi and self.plugged
        value.connector_type, value.connector_type_id = (11, 1) if hdmi else (10, 2)
        value.connection = 1 if plugged else 2
        modes = [mode(*size) for size in self.sizes] if plugged else []
        if value.modes_ptr and modes:
            array = (drm.Mode * len(modes)).from_address(value.modes_ptr)
            array[:] = modes
        if value.encoders_ptr:
            fill(value.encoders_ptr, [31])
        value.count_modes, value.count_encoders, value.count_props = len(modes), 1, 7

    def on_GETENCODER(self, value):
        assert value.encoder_id == 31
        value.possible_crtcs = 0b10

    def on_CREATE_DUMB(self, value):
        assert (value.width, value.height, value.bpp) == (320, 240, 32)
        value.handle, value.pitch, value.size = 5, PITCH, len(self.memory)

    def on_ADDFB(self, value):
        assert (value.handle, value.pitch, value.depth, value.bpp) == (5, PITCH, 24, 32)
        value.fb_id = 77

    def on_MAP_DUMB(self, value):
        assert value.handle == 5
        value.offset = 0x1000

    def on_SETCRTC(self, value):
        (connector,) = (ctypes.c_uint32 * 1).from_address(value.set_connectors_ptr)
        shown = value.mode.hdisplay, value.mode.vdisplay
        self.shown = value.crtc_id, connector, value.fb_id, shown

    def on_RMFB(self, value):
        assert value.value == 77

    def on_DESTROY_DUMB(self, value):
        assert value.handle == 5


def fill(address, numbers):
    (ctypes.c_uint32 * len(numbers)).from_address(address)[:] = numbers


def mode(width, height):
    return drm.Mode(hdisplay=width, vdisplay=height, vrefresh=60)


def open_on(kernel, connector='HDMI-A-1'):
    return DrmDisplay('/dev/null', connector, SIZE, kernel.ioctl, kernel.map)


def test_requests_are_the_kernels():
    assert {name: getattr(drm, name) for name in REQUESTS} == REQUESTS
    assert ctypes.sizeof(drm.Mode) == 68


def test_the_pattern_is_lit_in_its_mode_bit_for_bit():
    kernel = Kernel()
    display = open_on(kernel)
    display.show(PATTERN.draw())
    assert display.trouble == ''
    assert kernel.shown == (42, HDMI, 77, SIZE)
    rows = np.frombuffer(kernel.memory, np.uint8).reshape(240, PITCH)
    pixels = rows[:, : 4 * 320].reshape(240, 320, 4)
    np.testing.assert_array_equal(pixels[..., 2::-1], PATTERN.draw())
    assert not rows[:, 4 * 320 :].any()
    assert kernel.calls == [
        'SET_MASTER',
        *look(),
        *('CREATE_DUMB', 'ADDFB', 'MAP_DUMB'),
        *look(),
        *('GETRESOURCES', 'GETRESOURCES', 'GETENCODER', 'SETCRTC'),
        *look(),
    ]
    display.close()
    assert kernel.calls[-2:] == ['RMFB', 'DESTROY_DUMB']


def look():
    """What asking for a connector's state takes: everything twice, for counts come first."""
    return ('GETRESOURCES', 'GETRESOURCES', *['GETCONNECTOR'] * 4)


def test_a_projector_that_comes_back_is_lit_again():
    kernel = Kernel(plugged=False)
    display = open_on(kernel)
    assert 'no display is plugged into HDMI-A-1' in display.trouble
    assert kernel.shown is None
    kernel.plugged = True
    display.refresh()
    assert display.trouble == ''
    assert kernel.shown == (42, HDMI, 77, SIZE)
    kernel.plugged, kernel.shown = False, None
    display.refresh()
    assert 'plug it in' in display.trouble
    kernel.plugged = True
    display.refresh()
    assert kernel.shown is not None


def test_what_cannot_be_shown_is_told():
    display = open_on(Kernel(sizes=((1920, 1080), (1280, 720))))
    assert 'no mode of 320x240 pixels' in display.trouble
    assert 'it has 1280x720, 1920x1080' in display.trouble
    with pytest.raises(ConfigurationError, match=r'no connector HDMI-A-2 .it has DP-2, HDMI-A-1'):
        open_on(Kernel(), 'HDMI-A-2')
    assert open_on(Kernel(), '').trouble == ''
    with pytest.raises(ConfigurationError, match='cannot be opened'):
        DrmDisplay('/dev/dri/card99', '', SIZE)
    with pytest.raises(ConfigurationError, match='no display device'):
        DrmDisplay('/dev/null', '', SIZE)
