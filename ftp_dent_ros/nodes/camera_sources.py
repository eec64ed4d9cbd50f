"""The source of images that the parameters of camera_capture describe."""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path

from ftp_dent_ros.capture.device import DeviceSource
from ftp_dent_ros.capture.files import FileSource
from ftp_dent_ros.capture.simulated import RenderedSource, SimulatedSource
from ftp_dent_ros.capture.source import ExposureClock, Source, stamps_exposure_start
from ftp_dent_ros.capture.v4l2 import open_device
from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.nodes.camera_parameters import CameraParameters


def make_source(given: CameraParameters, now_ns: Callable[[], int]) -> Source:
    """Make the source, on ROS time in nanoseconds."""
    if given.source == 'device':
        return _device(given, now_ns)
    if given.source == 'genicam':
        # Imported only here: others need no Aravis.
        from ftp_dent_ros.capture.aravis import GenicamSource

        clock = ExposureClock(given.device.exposure, given.stamps != 'end', given.stamp_offset)
        return GenicamSource(given.genicam, given.rate, clock, now_ns)
    rig = given.rig
    if given.source == 'files':
        size = (rig.camera.width, rig.camera.height) if rig else None
        return FileSource(given.files, given.rate, given.loop, size, now_ns, given.encoding)
    if rig is None or given.scene is None:
        lacking = 'rig' if rig is None else 'simulation.scene'
        raise ConfigurationError(
            f'the simulation needs its {lacking}: set the parameter {lacking}'
        )
    if given.ahead:
        return RenderedSource(Path(given.ahead), given.rate, given.start_ns, now_ns)
    # Imported only here: a real camera needs none of it.
    from ftp_dent_ros.simulation.world import LiveWorld

    world = LiveWorld(given.scene, given.start_ns)
    return SimulatedSource(functools.partial(world.photograph, rig), given.rate, now_ns)


def _device(given: CameraParameters, now_ns: Callable[[], int]) -> Source:
    device, stamps = given.device, given.stamps
    if not device.width or not device.height:
        raise ConfigurationError(
            'the size of the images is not known: set rig, or device.width and device.height'
        )
    at_start = stamps == 'start' or (stamps == 'auto' and stamps_exposure_start(device.path))
    clock = ExposureClock(device.exposure, at_start, given.stamp_offset)
    return DeviceSource(functools.partial(open_device, device), given.rate, clock, now_ns)
