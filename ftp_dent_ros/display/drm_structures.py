"""Structures and request numbers of the kernel's mode setting (uapi ``drm_mode.h``)."""

from __future__ import annotations

import ctypes
from ctypes import c_char, c_int32, c_uint16, c_uint32, c_uint64

CONNECTED = 1
_PREFERRED = 1 << 3
_NAMES = (
    *('Unknown', 'VGA', 'DVI-I', 'DVI-D', 'DVI-A', 'Composite', 'SVIDEO', 'LVDS', 'Component'),
    *('DIN', 'DP', 'HDMI-A', 'HDMI-B', 'TV', 'eDP', 'Virtual', 'DSI', 'DPI', 'Writeback'),
    *('SPI', 'USB'),
)


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


SET_MASTER = ord('d') << 8 | 0x1E
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
