"""A GigE Vision camera on the loopback that sends one photograph again and again.

Aravis's own fake camera sends a ramp; its library lets another function fill the frames.

python fake_genicam.py SERIAL PHOTOGRAPH.npy
"""

from __future__ import annotations

import ctypes
import sys
import threading

import numpy as np

FILL = ctypes.CFUNCTYPE(
    None,
    ctypes.c_void_p,
    ctypes.c_void_p,
    ctypes.c_uint32,
    ctypes.c_uint32,
    ctypes.c_uint32,
)


def main() -> None:
    serial, path = sys.argv[1:]
    pixels = np.ascontiguousarray(np.load(path)).tobytes()
    aravis = ctypes.CDLL('libaravis-0.8.so.0')
    aravis.arv_gv_fake_camera_new.restype = ctypes.c_void_p
    aravis.arv_gv_fake_camera_get_fake_camera.restype = ctypes.c_void_p
    aravis.arv_gv_fake_camera_get_fake_camera.argtypes = [ctypes.c_void_p]
    aravis.arv_buffer_get_data.restype = ctypes.c_void_p
    aravis.arv_buffer_get_data.argtypes = [ctypes.c_void_p, ctypes.c_void_p]
    aravis.arv_fake_camera_get_payload.restype = ctypes.c_size_t
    aravis.arv_fake_camera_get_payload.argtypes = [ctypes.c_void_p]
    aravis.arv_fake_camera_set_fill_pattern.argtypes = [
        ctypes.c_void_p,
        FILL,
        ctypes.c_void_p,
    ]

    def fill(buffer, _, exposure, gain, pixel_format):
        # What the frame holds is known only once it is filled: the camera knows what it takes.
        room = aravis.arv_fake_camera_get_payload(inner)
        ctypes.memmove(aravis.arv_buffer_get_data(buffer, None), pixels, min(room, len(pixels)))

    kept = FILL(fill)
    camera = aravis.arv_gv_fake_camera_new(b'127.0.0.1', serial.encode())
    inner = aravis.arv_gv_fake_camera_get_fake_camera(camera)
    aravis.arv_fake_camera_set_fill_pattern(inner, kept, None)
    threading.Event().wait()


if __name__ == '__main__':
    main()
