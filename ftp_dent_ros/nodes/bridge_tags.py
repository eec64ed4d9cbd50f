"""What the bridge publishes of a cloud that has a pose."""

from __future__ import annotations

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import PointCloud2

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.coding.cloud_codec import thinned
from ftp_dent_ros.navigation import pose_covariance
from ftp_dent_ros.navigation.pose_covariance import Covariance, Tag
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.ros.diagnostics import Diagnostics
from ftp_dent_ros.ros.messages import (
    cloud_from_message,
    cloud_to_message,
    make_header,
    pose_to_message,
)
from ftp_dent_ros.ros.qos import OVERRIDABLE, POSES, PREVIEWS


class BridgeTags:
    """Publishes ``tagged/points``, ``tagged/preview``, ``tagged/camera_pose``, ``tagged/pose``.

    All or none, but for clouds that nobody subscribes to.

    Parameters
    ----------
    node : Node
    frame : str
        Name of the map.
    mount : Pose
        Of the camera's optical frame on the vehicle.
    mount_covariance : ndarray, shape (6, 6)
        In the vehicle's axes.
    most_at_once : int
        How many clouds may get their poses at one moment.
    preview_columns : int
        Largest width of ``tagged/preview``, points.
    diagnostics : Diagnostics
    """

    def __init__(
        self,
        node: Node,
        frame: str,
        mount: Pose,
        mount_covariance: Covariance,
        most_at_once: int,
        preview_columns: int,
        diagnostics: Diagnostics,
    ) -> None:
        self._frame, self._mount, self._mount_covariance = frame, mount, mount_covariance
        self._diagnostics, self._preview_columns = diagnostics, preview_columns
        # Clouds that waited for one report are published in one breath: a shorter history would
        # throw those away that nobody has fetched yet.
        history = QoSProfile(depth=max(10, most_at_once), reliability=ReliabilityPolicy.RELIABLE)
        self._points = node.create_publisher(
            PointCloud2, 'tagged/points', history, qos_overriding_options=OVERRIDABLE
        )
        self._preview = node.create_publisher(
            PointCloud2, 'tagged/preview', PREVIEWS, qos_overriding_options=OVERRIDABLE
        )
        depth = history if most_at_once > POSES.depth else POSES
        self._pose = node.create_publisher(PoseWithCovarianceStamped, 'tagged/pose', depth)
        self._camera_pose = node.create_publisher(
            PoseWithCovarianceStamped, 'tagged/camera_pose', depth
        )

    def publish(self, message: PointCloud2, stamp: int, tag: Tag) -> None:
        """Publish a cloud (in the camera's frame) with its pose.

        Raises
        ------
        CloudError
            It is malformed; nothing is published then.
        """
        camera = tag.pose @ self._mount
        covariance = pose_covariance.of_mounted(
            tag.covariance, tag.pose, self._mount, self._mount_covariance
        )
        # Read whether somebody takes it or not: of what is no cloud there is no pose either.
        cloud = cloud_from_message(message)
        self._publish_cloud(self._points, cloud, camera, stamp)
        if self._preview.get_subscription_count():
            few, _ = thinned(cloud, None, self._preview_columns)
            self._publish_cloud(self._preview, few, camera, stamp)
        self._camera_pose.publish(self._message(camera, covariance, stamp))
        self._pose.publish(self._message(tag.pose, tag.covariance, stamp))
        self._diagnostics.count('tagged')
        deviations = np.sqrt(np.diag(covariance))
        self._diagnostics.note('camera within, across (mm)', f'{1e3 * deviations[:2].max():.0f}')
        self._diagnostics.note('camera within, up (mm)', f'{1e3 * deviations[2]:.0f}')
        self._diagnostics.note('camera within (deg)', f'{np.degrees(deviations[3:].max()):.2f}')

    def _publish_cloud(self, publisher: Publisher, cloud: Cloud, camera: Pose, stamp: int) -> None:
        if publisher.get_subscription_count():
            in_map = cloud.transformed(camera)
            publisher.publish(cloud_to_message(in_map, stamp, self._frame))

    def _message(
        self, pose: Pose, covariance: Covariance, stamp: int
    ) -> PoseWithCovarianceStamped:
        message = PoseWithCovarianceStamped(header=make_header(stamp, self._frame))
        message.pose.pose = pose_to_message(pose)
        message.pose.covariance = covariance.ravel()
        return message
