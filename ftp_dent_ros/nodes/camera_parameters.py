"""The parameters of camera_capture and of all its sources, so that one file serves for each."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ftp_dent_ros.capture.aravis import GenicamSettings
from ftp_dent_ros.capture.device import DeviceSettings
from ftp_dent_ros.parameters import Declarations
from ftp_dent_ros.rig.rig import Rig, read_rig

SIMULATION = 'simulation'
SOURCES = ('device', 'genicam', 'files', SIMULATION)
_STAMPS = ('auto', 'start', 'end')


@dataclass(frozen=True)
class CameraParameters:
    """What camera_capture was given; of `device`, `files` and the scene `source` says which."""

    source: str
    rig: Rig | None
    rate: float
    continuous: bool
    frame_id: str
    device: DeviceSettings
    genicam: GenicamSettings
    stamps: str
    stamp_offset: float
    files: str
    encoding: str
    loop: bool
    scene: Path | None
    start_ns: int
    ahead: str


def declare(parameters: Declarations) -> CameraParameters:
    """Declare them; ``continuous`` changes while it runs."""
    file = parameters.file(
        'rig',
        '',
        'Calibration file (rig.yaml); without it camera_info says that the camera is '
        'uncalibrated.',
    )
    rig = read_rig(file) if file else None
    rate = parameters.declare(
        'rate', 2.0, 'Images a second; 0 for only on demand.', minimum=0.0, maximum=1000.0
    )
    source = parameters.declare('source', 'device', 'Where the images come from.', choices=SOURCES)
    scene = 'simulation.scene', 'shipped:scene.yaml', 'Scene file.'
    if source != SIMULATION:
        parameters.path(*scene)
    # A V4L2 camera is asked for a size; a GenICam camera without a rig keeps its own.
    size = (rig.camera.width, rig.camera.height) if rig else (1280, 720)
    device = _declare_device(parameters, size if rig or source == 'device' else (0, 0), rate)
    return CameraParameters(
        source=source,
        rig=rig,
        rate=rate,
        continuous=parameters.declare(
            'continuous',
            True,
            'Whether images are taken at the rate; if not, only on demand.',
            changeable=True,
        ),
        frame_id=parameters.declare(
            'frame_id', 'camera_optical_frame', "The camera's optical frame."
        ),
        device=device,
        genicam=_declare_genicam(parameters, device),
        stamps=parameters.declare(
            'device.stamps',
            'auto',
            "What the driver's time stamps are of: the start of the exposure or the end of the "
            'frame; auto knows uvcvideo.',
            choices=_STAMPS,
        ),
        stamp_offset=parameters.declare(
            'device.stamp_offset',
            0.0,
            "Seconds added to every stamp, for what is known of the camera's delay.",
            minimum=-10.0,
            maximum=10.0,
        ),
        files=parameters.path(
            'files.path', '', 'A folder of images, a pattern of names (with * or ?), or a video.'
        ),
        encoding=parameters.declare(
            'files.encoding',
            '',
            'What image files cannot say of their pixels, as bayer_rggb12; empty for what they '
            'say.',
        ),
        loop=parameters.declare('files.loop', True, 'Whether the first image follows the last.'),
        scene=parameters.file(*scene) if source == SIMULATION else None,
        start_ns=parameters.declare(
            'simulation.start_ns',
            0,
            'ROS time at which the simulated flight starts, nanoseconds.',
        ),
        ahead=parameters.path(
            'simulation.ahead',
            '',
            'A folder of photographs that the demonstration rendered ahead; empty renders each as '
            'it is due.',
        ),
    )


def _declare_genicam(parameters: Declarations, device: DeviceSettings) -> GenicamSettings:
    """A GenICam camera's own parameters; size, rate, exposure and gain are those of a device."""
    return GenicamSettings(
        camera=parameters.declare(
            'genicam.camera',
            '',
            'Name, serial number or address of a GenICam camera; empty for the first.',
        ),
        pixel_format=parameters.declare(
            'genicam.pixel_format',
            '',
            'Pixel format of a GenICam camera (Mono12, BayerRG12p, RGB8); empty leaves it as it '
            'is.',
        ),
        trigger=parameters.declare(
            'genicam.trigger',
            '',
            'Trigger of a GenICam camera: Software, a line (Line1), or empty to run freely.',
        ),
        width=device.width,
        height=device.height,
        rate=device.rate,
        exposure=device.exposure,
        gain=device.gain,
    )


def _declare_device(
    parameters: Declarations, size: tuple[int, int], rate: float
) -> DeviceSettings:
    return DeviceSettings(
        path=parameters.declare('device.path', '/dev/video0', 'Device file of a V4L2 camera.'),
        width=parameters.declare(
            'device.width',
            size[0],
            "Width of the images, pixels; that of the rig's camera by default.",
            minimum=0,
            maximum=65536,
        ),
        height=parameters.declare(
            'device.height',
            size[1],
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
            'Pixel format of V4L2 (MJPG, YUYV; GREY, "Y12 ", RG12 and the like as the sensor has '
            'them); empty leaves it as it is.',
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
