"""The parameters of every node: what each is called, its default, its range, and what it is for.

A node's parameters are the fields of a dataclass, declared by `read`, on a node or on the values
of a configuration (`fitted`), without rclpy. One file serves for each camera, so that those of all
its sources are there.
"""

# What is called for the fields is dataclasses.field.
# ruff: noqa: RUF009

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal, TypeVar

from ftp_dent_ros.capture.device import CameraSettings
from ftp_dent_ros.dents.dent import RANGES, SmallestDent
from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.ground.link import PORT, Security, endpoints
from ftp_dent_ros.navigation.settings import MOST_CLOCK_ERROR, VehicleSettings
from ftp_dent_ros.parameters import Declarations, flat
from ftp_dent_ros.pattern.file import read_pattern
from ftp_dent_ros.pattern.pattern import CODES, Pattern
from ftp_dent_ros.profilometry.settings import METHODS, TAU, UNWRAPPINGS, Settings
from ftp_dent_ros.rig.rig import Rig, read_rig
from ftp_dent_ros.supervision.configuration import NodeEntry
from ftp_dent_ros.supervision.executables import SIMULATED_AUTOPILOT

if TYPE_CHECKING:
    from ftp_dent_ros.dents.rules import Rules

Node = TypeVar('Node')
SIMULATION = 'simulation'
TAGGED = 'tagged'


def setting(
    default: Any,
    description: str,
    name: str = '',
    *,
    declare: str | Callable[[dict[str, Any]], str] = 'declare',
    load: Callable[[Any], Any] | None = None,
    **limits: Any,
) -> Any:
    """A parameter of a node, as a field.

    Parameters
    ----------
    default : bool, int, float, str or list of float
        Or a function of the fields that were read before, by name.
    description : str
    name : str
        Of the parameter; the field's own by default.
    declare : str
        The method of `Declarations` that takes it, or a function as of `default`.
    load : callable, optional
        What a value that is not empty becomes.
    **limits
        Of the method.
    """
    return field(metadata={'of': (default, description, name, declare, load, limits)})


def place(description: str, name: str = '', default: str = '') -> Any:
    """A parameter that says where something lies, whether it is there or not."""
    return setting(default, description, name, declare='path')


def file(load: Callable[[Path], Any], description: str, **limits: Any) -> Any:
    """A parameter that names a file, as what `load` makes of it; None if none is named."""
    return setting('', description, declare='file', load=load, **limits)


def read(node: type[Node], parameters: Declarations) -> Node:
    """Declare a node's parameters, and return what was given for them.

    Raises
    ------
    ConfigurationError
        A value is wrong: one sentence says which, and what to give.
    """
    given: dict[str, Any] = {}
    for each in fields(node):  # type: ignore[arg-type]
        default, description, name, declare, load, limits = each.metadata['of']
        default = default(given) if callable(default) else default
        take = getattr(parameters, declare(given) if callable(declare) else declare)
        value = take(name or each.name, default, description, **limits)
        given[each.name] = load(value) if load and value else value
    return node(**given)


def _read_key(path: Path) -> bytes:
    from ftp_dent_ros.navigation.signing import read_key

    return read_key(str(path))


def _read_rules(path: Path) -> Rules:
    from ftp_dent_ros.dents.rules import read_rules  # SciPy, which other nodes do without

    return read_rules(path)


@dataclass(frozen=True)
class PatternPublisherSettings:
    """Of pattern_publisher; `period_px`, `stripe_center_px` and `code` change while it runs."""

    period_px: float = setting(
        0.0,
        'Fringe period, projector pixels; 0 takes that of the pattern file.',
        minimum=0.0,
        maximum=1e4,
        changeable=True,
    )
    stripe_center_px: float = setting(
        0.0,
        "Column of the middle of the red stripe, or where the coded fringes' phase is zero, "
        'projector pixels; 0 takes that of the '
        "pattern file or, without one, the image's middle.",
        minimum=0.0,
        maximum=65536.0,
        changeable=True,
    )
    code: str = setting(
        'file',
        'How fringes tell which they are: stripe (the central one is red), contrast (each has its '
        'own, and no colour), or file: as the pattern file says; without one, stripe.',
        choices=('file', *CODES),
        changeable=True,
    )
    x: int = setting(
        0,
        "x of the display's upper left corner on the desktop, pixels.",
        'display.x',
        minimum=-65536,
        maximum=65536,
    )
    y: int = setting(
        0,
        "y of the display's upper left corner on the desktop, pixels.",
        'display.y',
        minimum=-65536,
        maximum=65536,
    )
    rig: Rig | None = file(read_rig, 'Calibration file (rig.yaml).')
    pattern: Pattern | None = file(
        read_pattern,
        "Pattern file (pattern.yaml); if empty, the size is that of the rig's projector and "
        'period_px must be set.',
    )
    frame_id: str = setting('projector_optical_frame', "The projector's frame.")
    shows: bool = setting(
        False, 'Show the pattern in full screen on a display.', 'display.enabled'
    )


def _image_size(given: dict[str, Any]) -> tuple[int, int]:
    """Size that images are asked for: a V4L2 camera has no own one, a GenICam camera keeps it."""
    if given['rig'] is not None:
        return given['rig'].camera.width, given['rig'].camera.height
    return (1280, 720) if given['source'] == 'device' else (0, 0)


@dataclass(frozen=True)
class CameraCaptureSettings:
    """Of camera_capture and of all its sources; `continuous` changes while it runs."""

    rig: Rig | None = file(
        read_rig,
        'Calibration file (rig.yaml); without it camera_info says that the camera is '
        'uncalibrated.',
    )
    rate: float = setting(
        2.0, 'Images a second; 0 for only on demand.', minimum=0.0, maximum=1000.0
    )
    source: str = setting(
        'device',
        'Where the images come from.',
        choices=('device', 'genicam', 'files', SIMULATION),
    )
    # A file that has to be there only if it is what is photographed.
    scene: Path | str | None = setting(
        'shipped:scene.yaml',
        'Scene file.',
        'simulation.scene',
        declare=lambda given: 'file' if given['source'] == SIMULATION else 'path',
    )
    path: str = setting('/dev/video0', 'Device file of a V4L2 camera.', 'device.path')
    width: int = setting(
        lambda given: _image_size(given)[0],
        "Width of the images, pixels; that of the rig's camera by default.",
        'device.width',
        minimum=0,
        maximum=65536,
    )
    height: int = setting(
        lambda given: _image_size(given)[1],
        "Height of the images, pixels; that of the rig's camera by default.",
        'device.height',
        minimum=0,
        maximum=65536,
    )
    device_rate: float = setting(
        lambda given: given['rate'],
        'Images a second asked of the driver, of which those due by rate are published; '
        'below 1 leaves it as it is.',
        'device.rate',
        minimum=0.0,
        maximum=1000.0,
    )
    fourcc: str = setting(
        '',
        'Pixel format of V4L2 (MJPG, YUYV; GREY, "Y12 ", RG12 and the like as the sensor has '
        'them); empty leaves it as it is.',
        'device.fourcc',
    )
    exposure: float = setting(
        0.0,
        'Fixed exposure, seconds; 0 leaves it as it is.',
        'device.exposure',
        minimum=0.0,
        maximum=10.0,
    )
    gain: float = setting(
        -1.0,
        "Fixed gain in the driver's unit; -1 leaves it as it is.",
        'device.gain',
        minimum=-1.0,
        maximum=1e6,
    )
    stamps: str = setting(
        'auto',
        "What the driver's time stamps are of: the start of the exposure or the end of the "
        'frame; auto knows uvcvideo.',
        'device.stamps',
        choices=('auto', 'start', 'end'),
    )
    stamp_offset: float = setting(
        0.0,
        "Seconds added to every stamp, for what is known of the camera's delay.",
        'device.stamp_offset',
        minimum=-10.0,
        maximum=10.0,
    )
    continuous: bool = setting(
        True, 'Whether images are taken at the rate; if not, only on demand.', changeable=True
    )
    frame_id: str = setting('camera_optical_frame', "The camera's optical frame.")
    camera: str = setting(
        '',
        'Name, serial number or address of a GenICam camera; empty for the first.',
        'genicam.camera',
    )
    pixel_format: str = setting(
        '',
        'Pixel format of a GenICam camera (Mono12, BayerRG12p, RGB8); empty leaves it as it is.',
        'genicam.pixel_format',
    )
    trigger: str = setting(
        '',
        'Trigger of a GenICam camera: Software, a line (Line1), or empty to run freely.',
        'genicam.trigger',
    )
    files: str = place(
        'A folder of images, a pattern of names (with * or ?), or a video.', 'files.path'
    )
    encoding: str = setting(
        '',
        'What image files cannot say of their pixels, as bayer_rggb12; empty for what they say.',
        'files.encoding',
    )
    loop: bool = setting(True, 'Whether the first image follows the last.', 'files.loop')
    start_ns: int = setting(
        0, 'ROS time at which the simulated flight starts, nanoseconds.', 'simulation.start_ns'
    )
    ahead: str = place(
        'A folder of photographs that the demonstration rendered ahead; empty renders each as '
        'it is due.',
        'simulation.ahead',
    )

    def __post_init__(self) -> None:
        """Refuse what no V4L2 camera can be asked for, whichever source is chosen."""
        self.asked()

    def asked(self) -> CameraSettings:
        """What is asked of a V4L2 or GenICam camera."""
        names = [each.name for each in fields(CameraSettings)]
        return CameraSettings(**{name: getattr(self, name) for name in names})


@dataclass(frozen=True)
class ReconstructionSettings:
    """Of reconstruction; `choices` change while it runs."""

    choices: ClassVar = ('method', 'unwrapping', 'tau', 'stride')
    rig: Rig | None = file(
        read_rig, 'Calibration file (rig.yaml); without it every image is refused.'
    )
    bits: int = setting(
        0,
        'Bits of the levels in images of 16, if they are the lower ones (10, 12 or 14); 0 for '
        'levels that fill them, as those of camera_capture do.',
        minimum=0,
        maximum=16,
    )
    camera_info_tolerance: float = setting(
        5.0,
        "Pixels by which a ray may differ between camera_info and the rig's camera; beyond "
        'it images are refused.',
        minimum=0.0,
        maximum=1e4,
    )
    # A projector of 60 Hz begins with the next frame (17 ms) and shows it up to five frames later
    # (83 ms); half an exposure and errors of the clocks come on top. As long before: whoever
    # shows the pattern as it arrives is as early as pattern_publisher tells of it (0.2 s).
    pattern_settling: float = setting(
        0.25,
        'Seconds around a change of the pattern within which photographs are refused.',
        minimum=0.0,
        maximum=60.0,
    )
    method: str = setting(
        Settings.method, 'How the phase is computed.', choices=tuple(METHODS), changeable=True
    )
    unwrapping: str = setting(
        UNWRAPPINGS[0],
        'How the Fourier methods unwrap the phase.',
        choices=tuple(UNWRAPPINGS),
        changeable=True,
    )
    tau: float = setting(
        TAU,
        "Gain of Estrada's unwrapping.",
        above=0.0,
        maximum=1.0,
        changeable=True,
    )
    stride: int = setting(
        Settings.stride,
        'Every how many pixels the cloud has a point, along rows and columns.',
        minimum=1,
        maximum=16,
        changeable=True,
    )


@dataclass(frozen=True)
class MavlinkBridgeSettings(VehicleSettings):
    """Of mavlink_bridge; `pose_timeout` changes while it runs."""

    address: str = setting(
        'udpin:127.0.0.1:14550',
        'The autopilot: udpin:HOST:PORT (listens; on 127.0.0.1 without HOST), '
        'udpout:HOST:PORT (sends first), tcp:HOST:PORT, or the path of a serial device.',
    )
    baud: int = setting(921600, 'Baud rate of a serial device.', minimum=1200, maximum=4_000_000)
    signing_key: bytes | None = file(
        _read_key,
        'File with the key of MAVLink signing, 32 bytes or 64 hexadecimal digits; what is not '
        'signed with it is refused. Without it nothing is signed.',
        secret=True,
    )
    map_frame: str = setting('map', "The map: ENU about the estimator's origin.")
    base_frame: str = setting('base_link', "The vehicle's body: FLU.")
    camera_frame: str = setting('camera_optical_frame', 'The frame that clouds come in.')
    translation: list[float] = setting(
        [0.1, 0.0, 0.0],
        'Position of the camera in the base frame: forward, left, up, metres.',
        'mount.translation',
        minimum=-100.0,
        maximum=100.0,
    )
    # It looks forward.
    rpy: list[float] = setting(
        [-math.pi / 2, 0.0, -math.pi / 2],
        "Roll, pitch, yaw of the camera's optical frame in the base frame, radians.",
        'mount.rpy',
        minimum=-2 * math.pi,
        maximum=2 * math.pi,
    )
    translation_uncertainty: float = setting(
        0.005,
        'Standard deviation of mount.translation along each axis, metres.',
        'mount.translation_uncertainty',
        minimum=0.0,
        maximum=100.0,
    )
    rotation_uncertainty: float = setting(
        0.01,
        'Standard deviation of mount.rpy about each axis, radians.',
        'mount.rotation_uncertainty',
        minimum=0.0,
        maximum=math.pi,
    )
    is_camera: bool = setting(
        False,
        'Whether the payload is a camera on the MAVLink side, too: tells of each photograph, and '
        'takes one when the ground station or the autopilot commands it.',
        'camera.enabled',
    )
    ground_station: int = setting(
        255,
        'MAVLink system id of the ground station that may command photographs.',
        'camera.ground_station',
        minimum=1,
        maximum=255,
    )
    rig: Rig | None = file(
        read_rig,
        "Calibration file (rig.yaml): of what size the camera's images are, for the MAVLink side; "
        'without it that is known with the first image.',
    )
    system_id: int = setting(
        VehicleSettings.system_id,
        'MAVLink system id of the autopilot; 0 for the first that is heard.',
        minimum=0,
        maximum=255,
    )
    component_id: int = setting(
        VehicleSettings.component_id,
        'MAVLink component id of the autopilot.',
        minimum=1,
        maximum=255,
    )
    rate: float = setting(
        VehicleSettings.rate,
        'Rate at which attitude and position are asked for, Hz.',
        minimum=10.0,
        maximum=200.0,
    )
    maximum_gap: float = setting(
        VehicleSettings.maximum_gap,
        'Longest time between two samples across which a pose is interpolated, seconds.',
        minimum=0.01,
        maximum=1.0,
    )
    maximum_clock_error: float = setting(
        VehicleSettings.maximum_clock_error,
        "Largest uncertainty of the autopilot's clock at which a cloud is tagged, seconds.",
        minimum=0.0001,
        maximum=MOST_CLOCK_ERROR,
    )
    earth: bool = setting(False, "Whether the map's origin on the earth goes to the topic earth.")
    position_source: Literal['gps', 'other'] = setting(
        VehicleSettings.position_source,
        'What the autopilot navigates by: gps, which is watched then (no tag without a new '
        'and good fix), or other (vision, motion capture).',
        choices=('gps', 'other'),
    )
    height_scale_uncertainty: float = setting(
        VehicleSettings.height_scale_uncertainty,
        "Standard deviation of height as a share of the height above the map's origin; 0 "
        'where it does not come from a barometer.',
        minimum=0.0,
        maximum=1.0,
    )
    pose_timeout: float = setting(
        1.0,
        'How long a cloud waits for its pose, seconds.',
        minimum=0.0,
        maximum=60.0,
        changeable=True,
    )
    queue_size: int = setting(5, 'How many clouds may wait at once.', minimum=1, maximum=1000)
    publish_tf: bool = setting(
        True, 'Whether poses and mount also go to TF, where tf2_msgs exists.'
    )
    preview_columns: int = setting(
        320,
        'Largest width of the clouds of tagged/preview, points.',
        minimum=16,
        maximum=1920,
    )


@dataclass(frozen=True)
class DentInspectorSettings:
    """Of dent_inspector."""

    source: str = setting(
        'points',
        'How clouds are taken: points, each by itself, or tagged with the camera pose, so '
        'that their dents become one list in the map.',
        choices=('points', TAGGED),
    )
    always: bool = setting(False, 'Whether the list is kept while nobody subscribes.')
    smallest_depth: float = setting(
        SmallestDent.smallest_depth,
        'Shallower dents are not reported, metres.',
        minimum=RANGES['smallest_depth'][0],
        maximum=RANGES['smallest_depth'][1],
    )
    smallest_width: float = setting(
        SmallestDent.smallest_width,
        'Narrower ones are rivets, scratches and gaps: no dents, metres.',
        minimum=RANGES['smallest_width'][0],
        maximum=RANGES['smallest_width'][1],
    )
    rules: Rules | None = file(_read_rules, 'File of limits to judge the list by.')
    list_file: str = place(
        'File that keeps the list of tagged clouds over a restart; if empty it is forgotten then.'
    )
    map_frame: str = setting('map', 'The frame that poses come in; others are refused.')

    def __post_init__(self) -> None:
        """Refuse a file that nothing would be written to."""
        if self.list_file and self.source != TAGGED:
            raise ConfigurationError(
                'list_file: only dents of tagged clouds are kept: set source to tagged, or leave '
                'list_file out'
            )


@dataclass(frozen=True)
class SurveySettings:
    """Of survey; the uncertainties are of poses that state none."""

    map_frame: str = setting('map', 'The frame that poses come in; others are refused.')
    queue_size: int = setting(
        5,
        'How many clouds may wait at once; of more, the oldest are dropped.',
        minimum=1,
        maximum=1000,
    )
    translation_uncertainty: float = setting(
        0.03,
        "Standard deviation of a pose's position along each axis if it states none, metres.",
        'unstated.translation_uncertainty',
        minimum=1e-6,
        maximum=100.0,
    )
    rotation_uncertainty: float = setting(
        0.015,
        "Standard deviation of a pose's turn about each axis if it states none, radians.",
        'unstated.rotation_uncertainty',
        minimum=1e-6,
        maximum=3.0,
    )


@dataclass(frozen=True)
class LinkSettings:
    """Of both ends of the link to the ground; an open link beyond this machine is refused."""

    role: ClassVar[str]
    address: str
    keys: str = place('Folder of the keys that `ftp-dent ground --make-keys` has made.')
    open: bool = setting(False, 'Whether, without keys, anybody in the network may use the link.')
    name: str = setting('payload', 'Name of the payload: the same at both ends.')

    def __post_init__(self) -> None:
        """Refuse what no link can be made of."""
        endpoints(self.address, self.security, self.role)

    @property
    def security(self) -> Security:
        """Keys of this end, or the explicit wish to do without."""
        return Security(Path(self.keys) if self.keys else None, self.open)


@dataclass(frozen=True)
class DownlinkSettings(LinkSettings):
    """Of downlink; the limit in kbit/s, the spool's size in MB."""

    role: ClassVar = 'drone'
    address: str = setting(
        f'127.0.0.1:{PORT}',
        'Where the ground connects to: HOST:PORT of an interface of the drone, or 0.0.0.0 for '
        'all of them.',
    )
    spool: str = place(
        'Where is kept what could not be sent yet; empty for in memory, until the node ends.',
        'spool.folder',
    )
    recordings: str = place('Folder of the bags that the ground starts.', default='~/recordings')
    limit: float = setting(
        0.0,
        'kbit/s to a ground that are never exceeded; 0 for as much as the link carries.',
        minimum=0.0,
        maximum=1e7,
    )
    room: int = setting(
        1000,
        'MB that may be kept; beyond it the oldest of the least importance are dropped.',
        'spool.size',
        minimum=1,
        maximum=10**6,
    )
    pictures: bool = setting(True, "Whether the camera's pictures are sent.")
    jpeg_quality: int = setting(85, 'Quality of the pictures.', minimum=10, maximum=100)
    preview_columns: int = setting(
        160, 'Largest width of the small clouds that go first, points.', minimum=16, maximum=1920
    )


@dataclass(frozen=True)
class GroundStationSettings(LinkSettings):
    """Of ground_station."""

    role: ClassVar = 'ground'
    address: str = setting(
        f'127.0.0.1:{PORT}',
        'The drone: HOST:PORT that its downlink listens on; with tcp/ before it where no '
        'datagrams pass.',
    )
    station: str = setting(
        '',
        "Name of this ground, other than any other's of the drone; the machine's by default.",
    )
    web: str = setting(
        '', "HOST:PORT of the page for browsers and of Foxglove's WebSocket; empty for none."
    )


@dataclass(frozen=True)
class SimulatedAutopilotSettings:
    """Of simulated_autopilot, which takes them as options: they are only checked here."""

    scene: Path | None = setting('shipped:scene.yaml', 'Scene file.', declare='file')
    address: str = setting('udpout:127.0.0.1:14550', 'Where the bridge is.')
    start_ns: int = setting(0, 'ROS time at which the flight starts, nanoseconds.')


OF_NODES: dict[str, Any] = {
    'pattern_publisher': PatternPublisherSettings,
    'camera_capture': CameraCaptureSettings,
    'reconstruction': ReconstructionSettings,
    'mavlink_bridge': MavlinkBridgeSettings,
    'dent_inspector': DentInspectorSettings,
    'survey': SurveySettings,
    'downlink': DownlinkSettings,
    'ground_station': GroundStationSettings,
}


def names_of_all() -> tuple[str, ...]:
    """Names of the parameters of all nodes."""
    given = Declarations({})
    for settings in OF_NODES.values():
        read(settings, given)
    return tuple(given.made)


def fitted(entries: Sequence[NodeEntry]) -> tuple[NodeEntry, ...]:
    """Entries whose parameters the nodes will take, with their relative paths made absolute.

    Relative to the folder of the configuration, that is.

    Raises
    ------
    ConfigurationError
        A parameter is wrong, or none of the node's; or a file that one names is not there.
    """
    return tuple(map(_fitted, entries))


def settings_of(entry: NodeEntry) -> Any:
    """A node's settings as it will have them: one of `OF_NODES`; raises as `fitted`."""
    return read(OF_NODES[entry.executable], _given(entry))


def _given(entry: NodeEntry) -> Declarations:
    values = {**dict(flat(entry.shared)), **dict(flat(entry.parameters))}
    return Declarations(values, entry.file.parent, f'{entry.file}: {entry.name}')


def _fitted(entry: NodeEntry) -> NodeEntry:
    if entry.executable == SIMULATED_AUTOPILOT:
        # No ROS node: what stands under /** is not for it.
        entry = replace(entry, shared={})
    own, given = dict(flat(entry.parameters)), _given(entry)
    read(OF_NODES.get(entry.executable, SimulatedAutopilotSettings), given)
    given.refuse_others(
        [name for name, _ in flat(entry.shared) if name not in own], names_of_all()
    )
    return replace(entry, absolute=given.absolute, files=given.files)
