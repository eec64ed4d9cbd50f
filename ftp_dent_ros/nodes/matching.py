"""Messages of one stamp, put together: a cloud, its camera's poses and the image of its skin."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Any

from geometry_msgs.msg import PoseWithCovarianceStamped
from numpy.typing import NDArray
from sensor_msgs.msg import Image, PointCloud2

from ftp_dent_ros.errors import PoseError
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.ros.messages import covariance_from_message, pose_from_message, stamp_to_ns

_POSES = ('pose', 'surveyed')


@dataclass(frozen=True)
class Matched:
    """A cloud with what there is of the same stamp."""

    cloud: PointCloud2
    pose: PoseWithCovarianceStamped | None = None
    surveyed: PoseWithCovarianceStamped | None = None
    skin: Image | None = None

    @property
    def best_pose(self) -> PoseWithCovarianceStamped | None:
        """By the skin, else by the autopilot."""
        return self.surveyed or self.pose


class MessageMatcher:
    """Hands over a cloud when a pose of it is there, and what else there will be.

    Parameters
    ----------
    hand_over : callable
        Called with each `Matched`, oldest first.
    refuse : callable
        Called with a reason and a sentence for what stayed alone.
    expects : callable
        What clouds come with at the moment beside their pose, of ``skin`` and ``surveyed``; one
        that is lost holds up its cloud until the next one is whole.
    posed : bool
        Whether a cloud is of use with a pose alone.
    """

    def __init__(
        self,
        hand_over: Callable[[Matched], Any],
        refuse: Callable[[str, str], Any],
        expects: Callable[[], Collection[str]] = tuple,
        posed: bool = True,
    ) -> None:
        self._hand_over, self._refuse, self._expects = hand_over, refuse, expects
        self._posed = posed
        self._waiting: dict[int, dict[str, Any]] = {}

    def add(self, **messages: Any) -> None:
        """Take a message, named as the fields of `Matched` are."""
        for part, message in messages.items():
            stamp_ns = stamp_to_ns(message.header.stamp)
            parts = self._waiting.setdefault(stamp_ns, {})
            parts[part] = message
            if self._is_of_use(parts) and parts.keys() >= set(self._expects()):
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
        self._refuse(f'no {missing}', f'a {had} came without its {missing}')

    def _is_of_use(self, parts: dict[str, Any]) -> bool:
        return 'cloud' in parts and not (self._posed and parts.keys().isdisjoint(_POSES))


def located(
    message: PoseWithCovarianceStamped, camera: str, frame: str
) -> tuple[Pose, NDArray[Any]]:
    """Pose and covariance of the camera that saw a cloud.

    Parameters
    ----------
    message : geometry_msgs/PoseWithCovarianceStamped
    camera, frame : str
        Frames that the cloud is in, and that poses have to be in.

    Raises
    ------
    PoseError
        It is in another frame, or holds no pose.
    """
    if message.header.frame_id == camera:
        raise PoseError(
            f'the pose is in the frame {camera!r} of its cloud: publish the cloud in the '
            "camera's frame, and its pose in the map",
            'wrong frame',
        )
    if message.header.frame_id != frame:
        raise PoseError(
            f'the pose is in the frame {message.header.frame_id!r}, the map is {frame!r}: '
            'set map_frame',
            'wrong frame',
        )
    return pose_from_message(message.pose.pose), covariance_from_message(message.pose.covariance)
