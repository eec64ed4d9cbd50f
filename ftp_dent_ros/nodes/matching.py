"""Messages of one stamp, put together: a cloud, its camera's poses and the image of its skin."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from geometry_msgs.msg import PoseWithCovarianceStamped
from numpy.typing import NDArray
from sensor_msgs.msg import Image, PointCloud2

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.errors import ImageError, PoseError
from ftp_dent_ros.nodes.payload_node import PayloadNode
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.ros.diagnostics import Diagnostics
from ftp_dent_ros.ros.messages import (
    cloud_from_message,
    covariance_from_message,
    image_from_message,
    pose_from_message,
    stamp_to_ns,
)
from ftp_dent_ros.ros.qos import CLOUDS, POSES

_TOPICS: dict[str, tuple[Any, str, Any]] = {
    'cloud': (PointCloud2, 'points', CLOUDS),
    'skin': (Image, 'skin', CLOUDS),
    'pose': (PoseWithCovarianceStamped, 'tagged/camera_pose', POSES),
    'surveyed': (PoseWithCovarianceStamped, 'survey/pose', POSES),
}
_POSES = ('pose', 'surveyed')


@dataclass(frozen=True)
class Matched:
    """A cloud with what there is of the same stamp."""

    cloud: PointCloud2
    pose: PoseWithCovarianceStamped | None = None
    surveyed: PoseWithCovarianceStamped | None = None
    skin: Image | None = None

    @property
    def stamp_ns(self) -> int:
        """Stamp of all of them."""
        return stamp_to_ns(self.cloud.header.stamp)

    def located(self, frame: str) -> tuple[Pose, NDArray[Any]]:
        """Pose in `frame` and covariance of the camera: by the skin, else by the autopilot.

        Raises
        ------
        PoseError
            It is in another frame, or holds no pose.
        """
        stated: Any = self.surveyed or self.pose
        camera = self.cloud.header.frame_id
        if stated.header.frame_id == camera:
            raise PoseError(
                f'the pose is in the frame {camera!r} of its cloud: publish the cloud in the '
                "camera's frame, and its pose in the map",
                'wrong frame',
            )
        if stated.header.frame_id != frame:
            raise PoseError(
                f'the pose is in the frame {stated.header.frame_id!r}, the map is {frame!r}: '
                'set map_frame',
                'wrong frame',
            )
        return pose_from_message(stated.pose.pose), covariance_from_message(stated.pose.covariance)

    def with_skin(self, diagnostics: Diagnostics) -> Cloud:
        """The cloud with the image of its skin; one that does not fit is refused by itself.

        Raises
        ------
        CloudError
            The cloud is malformed.
        """
        cloud = cloud_from_message(self.cloud)
        if self.skin is None:
            return cloud
        with diagnostics.guarded('a skin could not be read', 'wrong skin'):
            skin, shape = image_from_message(self.skin)[..., 0], cloud.valid.shape
            if skin.shape != shape:
                raise ImageError(
                    f'the image of the skin has {skin.shape} pixels where its cloud has {shape} '
                    'points: take both from one reconstruction'
                )
            return cloud.with_skin(skin)
        return cloud


class MessageMatcher:
    """Hands over a node's clouds, each when a pose of it is there, and what else there will be.

    While somebody publishes the skin or the survey's poses, clouds are expected to come with
    them; what is lost of these holds up its cloud until the next one is whole.

    Parameters
    ----------
    node : PayloadNode
        Subscribes; its diagnostics count the clouds, and refuse what stays alone.
    parts : sequence of str
        What is put together, of the fields of `Matched`. With `pose` among them a cloud is of use
        with a pose alone.
    hand_over : callable
        Called with each `Matched`, oldest first.
    wanted : callable
        Whether messages are of use at the moment.
    """

    def __init__(
        self,
        node: PayloadNode[Any],
        parts: tuple[str, ...],
        hand_over: Callable[[Matched], Any],
        wanted: Callable[[], bool] = lambda: True,
    ) -> None:
        self._node, self._parts = node, parts
        self._hand_over, self._wanted = hand_over, wanted
        self._waiting: dict[int, dict[str, Any]] = {}
        for part in parts:
            kind, topic, qos = _TOPICS[part]
            node.hear(kind, topic, partial(self._take, part), qos)

    def expects(self, part: str) -> bool:
        """Whether clouds come with a skin or a surveyed pose at the moment."""
        return part in self._parts and self._node.count_publishers(_TOPICS[part][1]) > 0

    def _take(self, part: str, message: Any) -> None:
        if part == 'cloud':
            self._node.diagnostics.count('clouds')
        if not self._wanted():
            return
        stamp_ns = stamp_to_ns(message.header.stamp)
        parts = self._waiting.setdefault(stamp_ns, {})
        parts[part] = message
        expected = {each for each in ('skin', 'surveyed') if self.expects(each)}
        if self._is_of_use(parts) and parts.keys() >= expected:
            # Each topic keeps its order: what is still missing before has been lost.
            for earlier in sorted(each for each in self._waiting if each <= stamp_ns):
                if self._is_of_use(self._waiting[earlier]):
                    self._hand_over(Matched(**self._waiting.pop(earlier)))
        # Stamps that may wait for the rest of their messages.
        while len(self._waiting) > 10:
            self._give_up(self._waiting.pop(next(iter(self._waiting))))

    def _give_up(self, parts: dict[str, Any]) -> None:
        if self._is_of_use(parts):
            self._hand_over(Matched(**parts))
            return
        missing = 'pose' if 'cloud' in parts else 'cloud'
        had = 'cloud' if 'cloud' in parts else ' and '.join(sorted(parts))
        self._node.diagnostics.refuse(f'no {missing}', f'a {had} came without its {missing}')

    def _is_of_use(self, parts: dict[str, Any]) -> bool:
        return 'cloud' in parts and ('pose' not in self._parts or bool(parts.keys() & _POSES))
