"""What the page on the ground shows, out of the items that come."""

from __future__ import annotations

import math
import threading
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.coding.cloud_codec import decode
from ftp_dent_ros.coding.messages import dents_from_message, pose_from_message, stamp_to_ns
from ftp_dent_ros.dents.dent import COVERAGE, KINDS
from ftp_dent_ros.errors import CloudError, CodecError, PoseError
from ftp_dent_ros.ground import topics
from ftp_dent_ros.ground.protocol import Item, remember
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.recording.topic import typestore
from ftp_dent_ros.rig.rig import Lens
from ftp_dent_ros.robust import deviation

_LIST = 'dents/list'
# Poses and areas seen that are kept: half an hour of two photographs a second.
_KEPT = 4000


def ring(dent: dict[str, Any]) -> NDArray[np.float64]:
    """Ellipse of a dent's length and width on the skin, in the map."""
    axis, normal = np.array(dent['axis'], float), np.array(dent['normal'], float)
    turn = np.linspace(0, 2 * np.pi, 32, endpoint=False)[:, None]
    length, width = (float(dent[name] or 0) * 0.5e-3 for name in ('length_mm', 'width_mm'))
    along, across = length * np.cos(turn) * axis, width * np.sin(turn) * np.cross(normal, axis)
    return np.array(dent['place'], float) + along + across


def corners(cloud: Cloud) -> NDArray[np.float64] | None:
    """The four measured points nearest to the grid's corners, in order around it."""
    rows, columns = np.nonzero(cloud.valid)
    if len(rows) < 4:
        return None
    picked = [
        int(np.argmin(sign_row * rows + sign_column * columns))
        for sign_row, sign_column in ((1, 1), (1, -1), (-1, -1), (-1, 1))
    ]
    return cloud.points[rows[picked], columns[picked]].astype(float)


def relief(cloud: Cloud) -> bytes:
    """Points and their deviation from the smooth skin, a quadric over the grid."""
    valid = cloud.valid
    points = cloud.points[valid].astype(float)
    if len(points) < 10:
        return b''
    centre = points.mean(axis=0)
    x, y, z = (points - centre).T
    basis = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)
    use = np.ones(len(z), bool)
    for _ in range(3):  # without the dents themselves
        coefficients, *_ = np.linalg.lstsq(basis[use], z[use], rcond=None)
        off = z - basis @ coefficients
        use = np.abs(off) <= 2.5 * max(deviation(off), 1e-7)
    # Away from the camera is into the skin: a dent is positive.
    values = np.column_stack([points - centre, 1e3 * off])
    return values.astype('<f4').tobytes()


def message_of(item: Item) -> Any:
    """Message of CDR, without ROS."""
    try:
        if len(item.data) > 4 << 20:
            raise ValueError
        return typestore().deserialize_cdr(item.data, item.kind.removeprefix('cdr:'))
    except Exception:
        raise CodecError(f'an item of {item.topic} holds no message: it is refused') from None


def path_of(message: Any) -> tuple[int, list[list[float]]]:
    """Stamp of a Path (ns), and its places, metres."""
    places = _places([each.pose.position for each in message.poses])
    return stamp_to_ns(message.header.stamp), places.tolist()


def coverage_of(message: Any) -> tuple[int, dict[str, list[list[list[float]]]]]:
    """Stamp of a coverage (ns), and its strips: ``measured`` and ``gaps``, four corners each."""
    # Two triangles each: of the second only the last corner is another.
    strips = {
        marker.ns: _places(marker.points).reshape(-1, 6, 3)[:, [0, 1, 2, 5]].tolist()
        for marker in message.markers
        if marker.ns in ('measured', 'gaps')
    }
    return stamp_to_ns(message.markers[0].header.stamp), strips


def _places(points: Sequence[Any]) -> NDArray[np.float64]:
    """Points of a message, to the millimetre; ValueError if one is none."""
    places: NDArray[np.float64] = np.asarray_chkfinite([[at.x, at.y, at.z] for at in points])
    return np.round(places, 3)


def statuses_of(message: Any) -> list[dict[str, Any]]:
    """What the nodes of a DiagnosticArray say."""
    return [
        {
            'name': status.name,
            'level': int(status.level),
            'message': status.message,
            'values': {each.key: each.value for each in status.values},
        }
        for status in message.status
    ]


def dents_of(message: Any) -> list[dict[str, Any]]:
    """Dents of a message of dents/list: lengths in millimetres, places in metres."""
    return [_dent(value) for value in dents_from_message(message)[:1000]]


def _dent(value: Any) -> dict[str, Any]:
    def number(name: str, factor: float = 1.0, digits: int = 4) -> float | None:
        given = float(value[name]) * factor
        return round(given, digits) if math.isfinite(given) else None

    dent: dict[str, Any] = {name: int(value[name]) for name in ('number', 'sightings')}
    dent['kind'] = KINDS[int(value['kind'])]
    for name, prefix in (('place', ''), ('normal', 'normal_'), ('axis', 'axis_')):
        dent[name] = [number(f'{prefix}{axis}') for axis in 'xyz']
    for name in ('length', 'width', 'depth'):
        dent[f'{name}_mm'] = number(name, 1e3, 3)
        # Half the 95 % interval.
        dent[f'{name}_interval_mm'] = number(f'{name}_uncertainty', COVERAGE * 1e3, 3)
    return dent


# How the page reads messages of which it shows the last.
_READERS: dict[str, Callable[[Any], Any]] = {
    topics.DIAGNOSTICS: statuses_of,
    _LIST: dents_of,
    topics.SURVEY_PATH: path_of,
    topics.SURVEY_COVERAGE: coverage_of,
}
# What reading a message of anything else may raise.
_MALFORMED = (ValueError, LookupError, TypeError, AttributeError, CloudError, PoseError, cv2.error)


class PageScene:
    """Takes items as they come and says what there is to see; for several threads.

    Attributes
    ----------
    version : int
        Grows with every change.
    """

    def __init__(self) -> None:
        self.version = 0
        self._lock = threading.Lock()
        # By topic; a survey's with the stamp up to which it goes.
        self._told: dict[str, Any] = {
            topics.DIAGNOSTICS: [],
            _LIST: [],
            topics.SURVEY_PATH: (0, []),
            topics.SURVEY_COVERAGE: (0, {}),
        }
        self._areas: deque[tuple[int, list[list[float]]]] = deque(maxlen=_KEPT)
        self._poses: dict[int, Pose] = {}
        self._lens: Lens | None = None
        # With their stamps.
        self._picture, self._size = (0, b''), (0, 0)
        self._cloud = 0, b''

    def take(self, item: Item) -> None:
        """Take an item.

        Raises
        ------
        CodecError
            It is not what it says.
        """
        take = {'jpeg': self._take_picture, 'cloud': self._take_cloud}
        with self._lock:
            try:
                take.get(item.kind, self._take_message)(item)
            except _MALFORMED:
                raise CodecError(f'an item of {item.topic} is malformed: it is refused') from None
            self.version += 1

    def state(self) -> dict[str, Any]:
        """What the page needs to know, for JSON."""
        with self._lock:
            survey_end, places = self._told[topics.SURVEY_PATH]
            newer = [self._poses[each] for each in sorted(self._poses) if each > survey_end]
            coverage_end, strips = self._told[topics.SURVEY_COVERAGE]
            return {
                'version': self.version,
                'dents': self._told[_LIST],
                # As the survey has them, and as clouds come from there on.
                'path': places + [np.round(each.translation, 3).tolist() for each in newer],
                'areas': strips.get('measured', [])
                + [area for stamp, area in self._areas if stamp > coverage_end],
                'gaps': strips.get('gaps', []),
                'statuses': self._told[topics.DIAGNOSTICS],
                'picture': self._drawn_picture(),
                'cloud': str(self._cloud[0]) if self.cloud else None,
            }

    @property
    def picture(self) -> bytes:
        """JPEG of the latest picture; empty for none."""
        return self._picture[1]

    @property
    def cloud(self) -> bytes:
        """float32 x, y, z (m) and deviation (mm) of each point of the latest small cloud."""
        return self._cloud[1]

    def _take_message(self, item: Item) -> None:
        if item.topic in _READERS:
            self._told[item.topic] = _READERS[item.topic](message_of(item))
        elif item.topic == topics.CAMERA_POSE:
            pose = pose_from_message(message_of(item).pose.pose)
            remember(self._poses, item.stamp_ns, pose, _KEPT)

    def _take_picture(self, item: Item) -> None:
        if item.stamp_ns < self._picture[0]:
            return
        image = cv2.imdecode(np.frombuffer(item.data, np.uint8), cv2.IMREAD_COLOR)
        if image is None:
            raise ValueError
        self._lens = item.lens or self._lens
        self._picture, self._size = (item.stamp_ns, item.data), (image.shape[1], image.shape[0])

    def _take_cloud(self, item: Item) -> None:
        if item.topic != topics.PREVIEW_POINTS:
            return
        cloud = decode(item.data)
        pose, ends = self._poses.get(item.stamp_ns), corners(cloud)
        if pose is not None and ends is not None:
            area = np.round(pose.apply(ends), 3).tolist()
            self._areas.append((item.stamp_ns, area))
        if item.stamp_ns >= self._cloud[0]:
            self._cloud = item.stamp_ns, relief(cloud)

    def _drawn_picture(self) -> dict[str, Any] | None:
        """The picture, and where the dents lie in it if its camera's pose is known."""
        if not self.picture:
            return None
        stamp, (width, height) = self._picture[0], self._size
        outlines = []
        if stamp in self._poses and self._lens is not None:
            to_camera, scale = self._poses[stamp].inverse(), width / self._lens.width
            for dent in self._told[_LIST]:
                around = to_camera.apply(ring(dent))
                if (around[:, 2] <= 0).any():
                    continue
                pixels = self._lens.project(around) * scale
                is_near = ((pixels > -width) & (pixels < 2 * width)).all()
                if is_near and ((pixels > 0) & (pixels < [width, height])).any():
                    points = np.round(pixels, 1).tolist()
                    outlines.append(
                        {'number': dent['number'], 'kind': dent['kind'], 'points': points}
                    )
        return {'stamp': str(stamp), 'width': width, 'height': height, 'outlines': outlines}
