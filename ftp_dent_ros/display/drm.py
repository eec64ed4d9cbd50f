"""Structures and request numbers of the kernel's mode setting (uapi ``drm_mode.h``)."""

from __future__ import annotations

import contextlib
import ctypes
import errno
import fcntl
import mmap
import os
from collections.abc import Callable
from ctypes import c_char, c_int32, c_uint16, c_uint32, c_uint64
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.errors import ConfigurationError

CONNECTED = 1
_PREFERRED = 1 << 3
_NAMES = (
    *('Unknown', 'VGA', 'DVI-I', 'DVI-D', 'DVI-A', 'Composite', 'SVIDEO', 'LVDS', 'Component'),
    *('DIN', 'DP', 'HDMI-A', 'HDMI-B', 'TV', 'eDP', 'Virtual', 'DSI', 'DPI', 'Writeback'),
    *('SPI', 'USB'),
)


SET_MASTER = ord('d') << 8 | 0x1E

_BITS, _DEPTH = 32, 24

Ioctl = Callable[[int, int, Any], Any]


class Mode(ctypes.Structure):
    """``drm_mode_modeinfo``."""

    _fields_ = (
        ('clock', c_uint32),
        *((name, c_uint16) for name in ('hdisplay', 'hsync_start', 'hsync_end', 'htotal')),
        *((name, c_uint16) for name in ('hskew', 'vdisplay', 'vsync_start', 'vsync_end')),
        *((name, c_uint16) for name in ('vtotal', 'vscan')),
        *((name, c_uint32) for name in ('vrefresh', 'flags', 'type')),
        ('name', c_char * 32),
    )

    @property
    def preferred(self) -> bool:
        """Whether the display prefers it."""
        return bool(self.type & _PREFERRED)


class Resources(ctypes.Structure):
    """``drm_mode_card_res``."""

    _fields_ = (
        *((f'{name}_id_ptr', c_uint64) for name in ('fb', 'crtc', 'connector', 'encoder')),
        *((f'count_{name}', c_uint32) for name in ('fbs', 'crtcs', 'connectors', 'encoders')),
        *((name, c_uint32) for name in ('min_width', 'max_width', 'min_height', 'max_height')),
    )

    def make_room(self) -> None:
        """Arrays of the counted lengths for the second call."""
        self._crtcs = (c_uint32 * self.count_crtcs)()
        self._connectors = (c_uint32 * self.count_connectors)()
        self.crtc_id_ptr = ctypes.addressof(self._crtcs)
        self.connector_id_ptr = ctypes.addressof(self._connectors)
        self.count_fbs = self.count_encoders = 0

    @property
    def crtcs(self) -> list[int]:
        """Identifiers."""
        return list(self._crtcs)

    @property
    def connectors(self) -> list[int]:
        """Identifiers."""
        return list(self._connectors)


class Connector(ctypes.Structure):
    """``drm_mode_get_connector``."""

    _fields_ = (
        *((f'{name}_ptr', c_uint64) for name in ('encoders', 'modes', 'props', 'prop_values')),
        *((f'count_{name}', c_uint32) for name in ('modes', 'props', 'encoders')),
        *((name, c_uint32) for name in ('encoder_id', 'connector_id', 'connector_type')),
        *((name, c_uint32) for name in ('connector_type_id', 'connection')),
        *((name, c_uint32) for name in ('mm_width', 'mm_height', 'subpixel', 'pad')),
    )

    def make_room(self) -> None:
        """Arrays of the counted lengths for the second call."""
        self._modes = (Mode * self.count_modes)()
        self._encoders = (c_uint32 * self.count_encoders)()
        self.modes_ptr = ctypes.addressof(self._modes)
        self.encoders_ptr = ctypes.addressof(self._encoders)
        self.count_props = 0

    @property
    def modes(self) -> list[Mode]:
        """What the display can show."""
        return list(self._modes[: self.count_modes])

    @property
    def encoders(self) -> list[int]:
        """Identifiers."""
        return list(self._encoders[: self.count_encoders])


class Encoder(ctypes.Structure):
    """``drm_mode_get_encoder``."""

    _fields_ = tuple(
        (name, c_uint32)
        for name in ('encoder_id', 'encoder_type', 'crtc_id', 'possible_crtcs', 'possible_clones')
    )


class Crtc(ctypes.Structure):
    """``drm_mode_crtc``."""

    _fields_ = (
        ('set_connectors_ptr', c_uint64),
        *((name, c_uint32) for name in ('count_connectors', 'crtc_id', 'fb_id', 'x', 'y')),
        *((name, c_uint32) for name in ('gamma_size', 'mode_valid')),
        ('mode', Mode),
    )


class CreateDumb(ctypes.Structure):
    """``drm_mode_create_dumb``."""

    _fields_ = (
        *((name, c_uint32) for name in ('height', 'width', 'bpp', 'flags', 'handle', 'pitch')),
        ('size', c_uint64),
    )


class MapDumb(ctypes.Structure):
    """``drm_mode_map_dumb``."""

    _fields_ = (('handle', c_uint32), ('pad', c_uint32), ('offset', c_uint64))


class DestroyDumb(ctypes.Structure):
    """``drm_mode_destroy_dumb``."""

    _fields_ = (('handle', c_uint32),)


class FrameBuffer(ctypes.Structure):
    """``drm_mode_fb_cmd``."""

    _fields_ = tuple(
        (name, c_uint32)
        for name in ('fb_id', 'width', 'height', 'pitch', 'bpp', 'depth', 'handle')
    )


def _both_ways(number: int, size: int) -> int:
    """``DRM_IOWR``."""
    return 3 << 30 | size << 16 | ord('d') << 8 | number


GETRESOURCES = _both_ways(0xA0, ctypes.sizeof(Resources))
SETCRTC = _both_ways(0xA2, ctypes.sizeof(Crtc))
GETENCODER = _both_ways(0xA6, ctypes.sizeof(Encoder))
GETCONNECTOR = _both_ways(0xA7, ctypes.sizeof(Connector))
ADDFB = _both_ways(0xAE, ctypes.sizeof(FrameBuffer))
RMFB = _both_ways(0xAF, ctypes.sizeof(c_int32))
CREATE_DUMB = _both_ways(0xB2, ctypes.sizeof(CreateDumb))
MAP_DUMB = _both_ways(0xB3, ctypes.sizeof(MapDumb))
DESTROY_DUMB = _both_ways(0xB4, ctypes.sizeof(DestroyDumb))


def connector_name(connector: Connector) -> str:
    """As the kernel writes it: ``HDMI-A-1``."""
    kind = connector.connector_type
    return f'{_NAMES[kind] if kind < len(_NAMES) else "Unknown"}-{connector.connector_type_id}'


class DrmDisplay:
    """The pattern on a connector, pixel for pixel.

    Parameters
    ----------
    device : str
        ``/dev/dri/cardN``.
    connector : str
        As the kernel names it (``HDMI-A-1``); empty for the first with a display.
    size : (int, int)
        Width and height of the pattern: the mode is chosen by it.
    ioctl, map_memory : callable
        Of the kernel; a test's own.

    Attributes
    ----------
    trouble : str
        What is wrong with what is shown; empty if nothing is.

    Raises
    ------
    ConfigurationError
        The device cannot be used, or it has no such connector.
    """

    def __init__(
        self,
        device: str,
        connector: str,
        size: tuple[int, int],
        ioctl: Ioctl = fcntl.ioctl,
        map_memory: Callable[[int, int, int], Any] | None = None,
    ) -> None:
        self.trouble = ''
        self._device, self._name, self._size = device, connector, size
        self._ioctl, self._map = ioctl, map_memory or _mapped
        self._lit = False
        try:
            self._file = os.open(device, os.O_RDWR | os.O_CLOEXEC)
        except OSError as reason:
            raise ConfigurationError(
                f'{device}: cannot be opened ({reason.strerror}): check display.device and that '
                'this user is in the group video'
            ) from None
        try:
            self._be_master()
            self._connector()  # that there is one of the name
            self._buffer, self._frame, self._pitch, self._memory = self._make_buffer()
        except BaseException:
            os.close(self._file)
            raise
        self.refresh()

    def show(self, image: NDArray[np.uint8]) -> None:
        """Show RGB pixels of shape (height, width, 3)."""
        width, height = self._size
        rows = np.frombuffer(self._memory, np.uint8).reshape(-1, self._pitch)
        pixels = rows[:height, : 4 * width].reshape(height, width, 4)
        pixels[..., 2::-1] = image  # blue, green, red, unused
        self.refresh()

    def refresh(self) -> None:
        """Light the connector if it is dark: at first, and when the projector comes back."""
        try:
            connector = self._connector()
        except OSError as reason:
            self.trouble = f'{self._device}: {reason.strerror}'
            return
        if connector.connection != CONNECTED:
            self._lit = False
            self.trouble = f'no display is plugged into {connector_name(connector)}: plug it in'
            return
        if self._lit:
            return
        mode = self._mode(connector)
        if mode is None:
            offered = ', '.join(sorted({f'{m.hdisplay}x{m.vdisplay}' for m in connector.modes}))
            self.trouble = (
                f'the display at {connector_name(connector)} has no mode of '
                f"{self._size[0]}x{self._size[1]} pixels, the pattern's (it has {offered}): use a "
                'pattern of its size'
            )
            return
        self.trouble = self._light(connector, mode)
        self._lit = not self.trouble

    def close(self) -> None:
        """Let go of the buffer; the console comes back."""
        for request, value in (
            (RMFB, ctypes.c_uint32(self._frame)),
            (DESTROY_DUMB, DestroyDumb(self._buffer)),
        ):
            with contextlib.suppress(OSError):
                self._ioctl(self._file, request, value)
        os.close(self._file)

    def _be_master(self) -> None:
        try:
            self._ioctl(self._file, SET_MASTER, 0)
        except OSError as reason:
            if reason.errno not in (errno.EACCES, errno.EPERM, errno.EBUSY):
                raise ConfigurationError(
                    f'{self._device}: no display device ({reason.strerror}): check display.device'
                ) from None
            raise ConfigurationError(
                f'{self._device}: another program shows on it (a desktop?): end it, or set '
                'display.kind to window'
            ) from None

    def _resources(self) -> Resources:
        """Identifiers of connectors, encoders and CRTCs: asked for twice, counts first."""
        found = Resources()
        self._ioctl(self._file, GETRESOURCES, found)
        found.make_room()
        self._ioctl(self._file, GETRESOURCES, found)
        return found

    def _connector(self) -> Connector:
        """The chosen connector as it is now."""
        names = []
        first: Connector | None = None
        for number in self._resources().connectors:
            each = Connector(connector_id=number)
            self._ioctl(self._file, GETCONNECTOR, each)
            each.make_room()
            self._ioctl(self._file, GETCONNECTOR, each)
            name = connector_name(each)
            if name == self._name:
                return each
            if not self._name and each.connection == CONNECTED:
                return each
            first = first or each
            names.append(name)
        if self._name or first is None:
            raise ConfigurationError(
                f'{self._device}: has no connector {self._name or "at all"} (it has '
                f'{", ".join(names) or "none"}): set display.connector to one of these'
            )
        return first

    def _mode(self, connector: Connector) -> Mode | None:
        """The mode of the pattern's size: the display's preferred one, or the fastest."""
        fitting = [m for m in connector.modes if (m.hdisplay, m.vdisplay) == self._size]
        return max(fitting, key=lambda m: (m.preferred, m.vrefresh), default=None)

    def _light(self, connector: Connector, mode: Mode) -> str:
        resources = self._resources()
        for number in [connector.encoder_id, *connector.encoders]:
            if not number:
                continue
            encoder = Encoder(encoder_id=number)
            self._ioctl(self._file, GETENCODER, encoder)
            for index, crtc in enumerate(resources.crtcs):
                if encoder.possible_crtcs >> index & 1:
                    return self._set(crtc, connector, mode)
        return f'{connector_name(connector)} can be driven by no CRTC of {self._device}'

    def _set(self, crtc: int, connector: Connector, mode: Mode) -> str:
        number = (ctypes.c_uint32 * 1)(connector.connector_id)
        request = Crtc(
            set_connectors_ptr=ctypes.addressof(number),
            count_connectors=1,
            crtc_id=crtc,
            fb_id=self._frame,
            mode_valid=1,
            mode=mode,
        )
        try:
            self._ioctl(self._file, SETCRTC, request)
        except OSError as reason:
            return f'{connector_name(connector)} refuses its mode ({reason.strerror})'
        return ''

    def _make_buffer(self) -> tuple[int, int, int, Any]:
        width, height = self._size
        try:
            made = CreateDumb(height=height, width=width, bpp=_BITS)
            self._ioctl(self._file, CREATE_DUMB, made)
            form = {'pitch': made.pitch, 'bpp': _BITS, 'depth': _DEPTH}
            frame = FrameBuffer(width=width, height=height, handle=made.handle, **form)
            self._ioctl(self._file, ADDFB, frame)
            where = MapDumb(handle=made.handle)
            self._ioctl(self._file, MAP_DUMB, where)
            memory = self._map(self._file, made.size, where.offset)
        except OSError as reason:
            raise ConfigurationError(
                f'{self._device}: gives no buffer of {width}x{height} pixels '
                f'({reason.strerror}): check display.device'
            ) from None
        return made.handle, frame.fb_id, made.pitch, memory


def _mapped(file: int, size: int, offset: int) -> mmap.mmap:
    return mmap.mmap(file, size, offset=offset)
