from __future__ import annotations

import importlib.util

import numpy as np
import pytest
from numpy.testing import assert_allclose

from ftp_dent_ros.nodes.mavlink_bridge import TransformPublisher, transform_message
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.ros.messages import stamp_to_ns

POSE = Pose.from_rpy([0.1, -0.2, 0.3], [1.0, 2.0, 3.0])


def test_a_transform_has_frames_stamp_and_pose() -> None:
    message = transform_message(POSE, 'map', 'base_link', 1_700_000_000_123_456_789)
    assert (message.header.frame_id, message.child_frame_id) == ('map', 'base_link')
    assert stamp_to_ns(message.header.stamp) == 1_700_000_000_123_456_789
    translation, rotation = message.transform.translation, message.transform.rotation
    assert_allclose([translation.x, translation.y, translation.z], [1.0, 2.0, 3.0])
    given = np.array([rotation.x, rotation.y, rotation.z, rotation.w])
    assert_allclose(given * np.sign(given @ POSE.quaternion), POSE.quaternion)


def test_transforms_are_published_where_tf_is_installed(ros) -> None:
    publisher = TransformPublisher(ros.node)
    publisher.publish(POSE, 'base_link', 'camera_optical_frame', 1, static=True)
    publisher.publish(POSE, 'map', 'base_link', 2)
    if importlib.util.find_spec('tf2_msgs') is None:
        assert not ros.node.get_publishers_info_by_topic('/tf')
        pytest.skip('tf2_msgs is not installed: that /tf is published is not tested')
    from rclpy.qos import DurabilityPolicy, QoSProfile
    from tf2_msgs.msg import TFMessage

    moving = ros.collect(TFMessage, '/tf')
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    fixed = ros.collect(TFMessage, '/tf_static', latched)
    ros.until(lambda: fixed)
    ros.until(lambda: publisher.publish(POSE, 'map', 'base_link', 2) or moving)
    assert moving[0].transforms[0].child_frame_id == 'base_link'
    assert fixed[0].transforms[0].child_frame_id == 'camera_optical_frame'
