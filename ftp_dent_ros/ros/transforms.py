"""TF, where it is installed.

``tf2_msgs`` comes with a full ROS installation and not with the wheels; nothing depends on it.
"""

from __future__ import annotations

from geometry_msgs.msg import Transform, TransformStamped
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile

from ftp_dent_ros.pose import Pose
from ftp_dent_ros.ros.messages import make_header, pose_to_message

try:
    from tf2_msgs.msg import TFMessage
except ImportError:
    TFMessage = None

# As tf2_ros has them.
_DYNAMIC = QoSProfile(depth=100)
_STATIC = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def transform_message(pose: Pose, parent: str, child: str, stamp_ns: int) -> TransformStamped:
    """geometry_msgs/TransformStamped of the pose of a child frame in its parent."""
    message = pose_to_message(pose)
    transform = Transform(rotation=message.orientation)
    transform.translation.x = message.position.x
    transform.translation.y = message.position.y
    transform.translation.z = message.position.z
    return TransformStamped(
        header=make_header(stamp_ns, parent), child_frame_id=child, transform=transform
    )


class TransformPublisher:
    """Publishes on ``/tf`` and ``/tf_static``; does nothing where TF is not installed."""

    def __init__(self, node: Node) -> None:
        self._dynamic = self._static = None
        if TFMessage is not None:
            self._dynamic = node.create_publisher(TFMessage, '/tf', _DYNAMIC)
            self._static = node.create_publisher(TFMessage, '/tf_static', _STATIC)

    def publish(self, pose: Pose, parent: str, child: str, stamp_ns: int) -> None:
        """Publish a pose that changes."""
        if self._dynamic is not None:
            message = transform_message(pose, parent, child, stamp_ns)
            self._dynamic.publish(TFMessage(transforms=[message]))

    def publish_static(self, pose: Pose, parent: str, child: str, stamp_ns: int) -> None:
        """Publish a pose that never changes."""
        if self._static is not None:
            message = transform_message(pose, parent, child, stamp_ns)
            self._static.publish(TFMessage(transforms=[message]))
