"""GenICam cameras through Aravis."""

from __future__ import annotations

import ctypes
import time
from collections import deque
from typing import Any

import numpy as np

from ftp_dent_ros.capture.device import CameraSettings
from ftp_dent_ros.capture.raw_formats import GENICAM
from ftp_dent_ros.errors import CameraError
from ftp_dent_ros.photograph.photograph import Photograph

_LIBRARY = 'libaravis-0.8.so.0'


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

SOFTWARE = 'Software'

# Without a trigger, silence of so long means that the camera is gone, seconds.
_SILENCE = 3.0


class Error(ctypes.Structure):
    """``GError``."""

    _fields_ = (
        ('domain', ctypes.c_uint32),
        ('code', ctypes.c_int),
        ('message', ctypes.c_char_p),
    )


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


class GenicamCapture:
    """One camera, with `V4l2Capture`'s methods.

    Frames that lost packets are dropped and counted.

    Raises
    ------
    CameraError
        Aravis is not installed, or the camera is not found or refuses a setting.
    """

    def __init__(self, settings: CameraSettings) -> None:
        self._settings = settings
        self._camera = self._stream = None
        self._dropped = 0
        # How many frames the camera's clock is compared with the computer's over.
        self._offsets: deque[int] = deque(maxlen=100)
        self._image: Photograph | None = None
        self._host_ns = 0
        self._triggered = 0.0
        self._released = False
        self._library = load()
        try:
            self._open()
        except BaseException:
            self.release()
            raise

    def grab(self) -> bool:
        """Wait for the next whole frame; False if the camera has gone silent."""
        awaits_line = self._settings.trigger not in ('', SOFTWARE)
        end = time.monotonic() + _SILENCE
        while not self._released:
            self._trigger()
            # Between two looks at whether the source is to stop.
            buffer = self._library.arv_stream_timeout_pop_buffer(self._stream, 200_000)
            if buffer:
                try:
                    if self._library.arv_buffer_get_status(buffer) == 0:
                        self._take(buffer)
                        return True
                    self._dropped += 1
                finally:
                    self._library.arv_stream_push_buffer(self._stream, buffer)
            if time.monotonic() > end and (buffer or not awaits_line):
                return False
        return False

    def retrieve(self) -> Photograph | None:
        """The frame that was grabbed, as the sensor has it."""
        return self._image

    def notes(self) -> dict[str, object]:
        """How the camera does: of its clock against the computer's, the delivery's scatter."""
        offsets = np.array(self._offsets)
        scatter = np.median(offsets) - offsets.min() if len(offsets) > 1 else np.nan
        return {
            'frames dropped for lost packets': self._dropped,
            'time stamp uncertainty (ms)': f'{scatter / 1e6:.2f}',
        }

    def get(self, which: int) -> float:
        """Time of the grabbed frame on the monotonic clock, milliseconds."""
        age_ns = time.time_ns() - self._host_ns
        return (time.monotonic_ns() - age_ns) / 1e6

    def release(self) -> None:
        """Let go of the camera."""
        self._released = True
        if self._camera:
            self._library.arv_camera_stop_acquisition(self._camera, None)
        for each in (self._stream, self._camera):
            if each:
                self._library.g_object_unref(each)
        self._stream = self._camera = None

    def _open(self) -> None:
        given = self._settings
        self._library.arv_update_device_list()
        self._camera = camera = self._call('arv_camera_new', given.camera.encode() or None)
        is_free = not given.trigger and given.device_rate >= 1
        pixel_format = given.pixel_format.encode()
        for is_asked, function, *arguments in (
            (given.width and given.height, 'set_region', 0, 0, given.width, given.height),
            (given.pixel_format, 'set_pixel_format_from_string', pixel_format),
            (given.exposure, 'set_exposure_time', 1e6 * given.exposure),
            (given.gain >= 0, 'set_gain', given.gain),
            (given.trigger, 'set_trigger', given.trigger.encode()),
            (is_free, 'clear_triggers'),
            (is_free, 'set_frame_rate', given.device_rate),
        ):
            if is_asked:
                self._call(f'arv_camera_{function}', camera, *arguments)
        size = self._call('arv_camera_get_payload', camera)
        self._stream = self._call('arv_camera_create_stream', camera, None, None)
        # Frames that Aravis may fill ahead of us.
        for _ in range(8):
            buffer = self._library.arv_buffer_new(size, None)
            self._library.arv_stream_push_buffer(self._stream, buffer)
        self._call('arv_camera_start_acquisition', camera)

    def _trigger(self) -> None:
        """A software trigger at the rate."""
        if self._settings.trigger != SOFTWARE:
            return
        rate = self._settings.device_rate
        pause = 1 / rate if rate > 0 else 0.0
        time.sleep(max(0.0, self._triggered + pause - time.monotonic()))
        self._triggered = time.monotonic()
        self._call('arv_camera_software_trigger', self._camera)

    def _take(self, buffer: Any) -> None:
        library = self._library
        device_ns = library.arv_buffer_get_timestamp(buffer)
        arrived_ns = library.arv_buffer_get_system_timestamp(buffer)
        # The quickest delivery of late is the least that a frame takes.
        self._offsets.append(arrived_ns - device_ns)
        self._host_ns = device_ns + min(self._offsets) if device_ns else arrived_ns
        size = ctypes.c_size_t()
        data = library.arv_buffer_get_data(buffer, ctypes.byref(size))
        size_px = (
            library.arv_buffer_get_image_width(buffer),
            library.arv_buffer_get_image_height(buffer),
        )
        kind = library.arv_buffer_get_image_pixel_format(buffer)
        if kind not in GENICAM:
            raise CameraError(
                f'the camera sends the pixel format {kind:#010x}: set genicam.pixel_format to '
                'one of Mono8 to Mono16, BayerRG8 to BayerRG16 (or GR, GB, BG), RGB8 or BGR8'
            )
        # Copied: the buffer goes back to the camera.
        flat: Any = (ctypes.c_uint8 * size.value).from_address(data)
        pixels = np.frombuffer(flat, np.uint8).copy()
        self._image = GENICAM[kind].photograph(pixels, *size_px)

    def _call(self, function: str, *arguments: Any) -> Any:
        """Call what ends with a GError; raises it."""
        error = ctypes.POINTER(Error)()
        result = getattr(self._library, function)(*arguments, ctypes.byref(error))
        if error:
            why = error.contents.message.decode(errors='replace')
            self._library.g_error_free(error)
            which = self._settings.camera or 'the first GenICam camera'
            what = function.removeprefix('arv_camera_').replace('_', ' ')
            raise CameraError(f'{which}: {what}: {why}: check its cable and genicam.*')
        return result
