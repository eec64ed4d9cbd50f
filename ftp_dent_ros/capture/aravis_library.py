"""Aravis's C library and the types of its functions.

Through ctypes, not PyGObject: that is compiled for the system's own Python alone. The library is
apt's ``libaravis-0.8-0``; who has no such camera needs none of it.
"""

from __future__ import annotations

import ctypes
from typing import Any

from ftp_dent_ros.errors import CameraError

_LIBRARY = 'libaravis-0.8.so.0'


class Error(ctypes.Structure):
    """``GError``."""

    _fields_ = (
        ('domain', ctypes.c_uint32),
        ('code', ctypes.c_int),
        ('message', ctypes.c_char_p),
    )


_P, _S, _U64 = ctypes.c_void_p, ctypes.c_char_p, ctypes.c_uint64
# Result and arguments; those of functions that may fail end with a GError**.
_FUNCTIONS: dict[str, tuple[Any, ...]] = {
    'arv_update_device_list': (None,),
    'arv_camera_new': (_P, _S, _P),
    'arv_camera_set_region': (None, _P, *[ctypes.c_int] * 4, _P),
    'arv_camera_set_pixel_format_from_string': (None, _P, _S, _P),
    'arv_camera_set_exposure_time': (None, _P, ctypes.c_double, _P),
    'arv_camera_set_gain': (None, _P, ctypes.c_double, _P),
    'arv_camera_set_frame_rate': (None, _P, ctypes.c_double, _P),
    'arv_camera_set_trigger': (None, _P, _S, _P),
    'arv_camera_clear_triggers': (None, _P, _P),
    'arv_camera_software_trigger': (None, _P, _P),
    'arv_camera_get_payload': (ctypes.c_uint, _P, _P),
    'arv_camera_create_stream': (_P, _P, _P, _P, _P),
    'arv_camera_start_acquisition': (None, _P, _P),
    'arv_camera_stop_acquisition': (None, _P, _P),
    'arv_buffer_new': (_P, ctypes.c_size_t, _P),
    'arv_stream_push_buffer': (None, _P, _P),
    'arv_stream_timeout_pop_buffer': (_P, _P, _U64),
    'arv_buffer_get_status': (ctypes.c_int, _P),
    'arv_buffer_get_timestamp': (_U64, _P),
    'arv_buffer_get_system_timestamp': (_U64, _P),
    'arv_buffer_get_data': (_P, _P, _P),
    'arv_buffer_get_image_width': (ctypes.c_int, _P),
    'arv_buffer_get_image_height': (ctypes.c_int, _P),
    'arv_buffer_get_image_pixel_format': (ctypes.c_uint32, _P),
    'g_object_unref': (None, _P),
    'g_error_free': (None, _P),
}


def load() -> Any:
    """Aravis with the types of its functions; raises `CameraError` where it is missing."""
    try:
        library = ctypes.CDLL(_LIBRARY)
    except OSError:
        raise CameraError(
            'GenICam cameras need Aravis, which is not installed: sudo apt install libaravis-0.8-0'
        ) from None
    for name, (result, *arguments) in _FUNCTIONS.items():
        function = getattr(library, name)
        function.restype, function.argtypes = result, arguments
    return library
