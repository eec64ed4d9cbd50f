"""The parameters of camera_capture's sources, and the source that they describe."""

from __future__ import annotations

import functools
from collections.abc import Callable

from ftp_dent_ros.capture.device import DeviceSource
from ftp_dent_ros.capture.files import FileSource
from ftp_dent_ros.capture.simulated import SimulatedSource
from ftp_dent_ros.capture.source import Source
from ftp_dent_ros.capture.stamps import ExposureClock, stamps_exposure_start
from ftp_dent_ros.capture.v4l2 import DeviceSettings, open_device
from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.files import find
from ftp_dent_ros.rig import Rig
from ftp_dent_ros.ros.parameters import Parameters

SOURCES = ('device', 'files', 'simulation')
_STAMPS = ('auto', 'start', 'end')


def declare_source(
    parameters: Parameters, kind: str, rig: Rig | None, rate: float, now_ns: Callable[[], int]
) -> Source:
    """Declare the parameters of all sources, so that one file serves for each, and make one."""
    device = _declare_device(parameters, rig, rate)
    clock = _declare_clock(parameters, device)
    path = parameters.declare(
        'files.path', '', 'A folder of images, a pattern of names (with * or ?), or a video.'
    )
    loop = parameters.declare('files.loop', True, 'Whether the first image follows the last.')
    scene = parameters.declare(
        'simulation.scene', 'scene.yaml', 'Scene file, or the name of a shipped one.'
    )
    start_ns = parameters.declare(
        'simulation.start_ns', 0, 'ROS time at which the simulated flight starts, nanoseconds.'
    )
    if kind == 'device':
        if not device.width or not device.height:
            raise ConfigurationError(
                'the size of the images is not known: set rig, or device.width and device.height'
            )
        return DeviceSource(functools.partial(open_device, device), rate, clock, now_ns)
    if kind == 'files':
        size = (rig.camera.width, rig.camera.height) if rig else None
        return FileSource(path, rate, loop, size, now_ns)
    if rig is None:
        raise ConfigurationError('the simulation needs a rig: set the parameter rig')
    # Imported only here: a real camera needs none of it.
    from ftp_dent_ros.simulation.world import read_world

    world = read_world(find(scene), start_ns=start_ns)
    return SimulatedSource(functools.partial(world.photograph, rig), rate, now_ns)


def _declare_device(parameters: Parameters, rig: Rig | None, rate: float) -> DeviceSettings:
    return DeviceSettings(
        path=parameters.declare('device.path', '/dev/video0', 'Device file of a V4L2 camera.'),
        width=parameters.declare(
            'device.width',
            rig.camera.width if rig else 0,
            "Width of the images, pixels; that of the rig's camera by default.",
            minimum=0,
            maximum=65536,
        ),
        height=parameters.declare(
            'device.height',
            rig.camera.height if rig else 0,
            "Height of the images, pixels; that of the rig's camera by default.",
            minimum=0,
            maximum=65536,
        ),
        rate=parameters.declare(
            'device.rate',
            rate,
            'Images a second asked of the driver, of which those due by rate are published; '
            'below 1 leaves it as it is.',
            minimum=0.0,
            maximum=1000.0,
        ),
        fourcc=parameters.declare(
            'device.fourcc',
            '',
            'Pixel format of V4L2 (MJPG, YUYV); empty leaves it as it is.',
        ),
        exposure=parameters.declare(
            'device.exposure',
            0.0,
            'Fixed exposure, seconds; 0 leaves it as it is.',
            minimum=0.0,
            maximum=10.0,
        ),
        gain=parameters.declare(
            'device.gain',
            -1.0,
            "Fixed gain in the driver's unit; -1 leaves it as it is.",
            minimum=-1.0,
            maximum=1e6,
        ),
    )


def _declare_clock(parameters: Parameters, device: DeviceSettings) -> ExposureClock:
    stamps = parameters.declare(
        'device.stamps',
        'auto',
        "What the driver's time stamps are of: the start of the exposure or the end of the "
        'frame; auto knows uvcvideo.',
        choices=_STAMPS,
    )
    offset = parameters.declare(
        'device.stamp_offset',
        0.0,
        "Seconds added to every stamp, for what is known of the camera's delay.",
        minimum=-10.0,
        maximum=10.0,
    )
    at_start = stamps == 'start' or (stamps == 'auto' and stamps_exposure_start(device.path))
    return ExposureClock(device.exposure, at_start, offset)
