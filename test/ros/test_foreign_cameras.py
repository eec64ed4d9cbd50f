"""Camera drivers of other makes: best effort, and without camera_info."""

from __future__ import annotations

from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CameraInfo, Image, PointCloud2

from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.ros.messages import camera_info_message, image_to_message
from ftp_dent_ros.ros.qos import IMAGES, PATTERNS
from ftp_dent_ros.simulation import Panel, Renderer, Surface

PATTERN = Pattern(320, 200, 8.0, 160.0)
SKIN = Surface((Panel(Pose.from_rpy([0, 0.1, 0], [0, 0, 0.65]), (-1, 1, -1, 1)),))
BEST_EFFORT = QoSProfile(depth=2, reliability=ReliabilityPolicy.BEST_EFFORT)


def test_best_effort_lasts_as_long_as_such_a_publisher_and_is_said(ros, rig, rig_file):
    ros.start('reconstruction', rig=rig_file, pattern_settling=0.0)
    state = ros.diagnostics('reconstruction')
    clouds = ros.collect(PointCloud2, 'points')
    pattern = ros.publisher(Image, 'projector/image_raw', PATTERNS)
    pattern.publish(image_to_message(PATTERN.draw(), 1, 'projector'))
    camera = ros.node.create_publisher(Image, 'camera/image_raw', BEST_EFFORT)
    ros.until(camera.get_subscription_count)
    name = camera.topic_name
    photograph = Renderer(rig, PATTERN.draw()).render(SKIN)
    stamp_ns = 1_000_000_000

    def shown():
        nonlocal stamp_ns
        stamp_ns += 1_000_000
        camera.publish(image_to_message(photograph, stamp_ns, 'eye'))
        return clouds

    ros.until(shown)

    def says(words):
        ros.until(lambda: words in state.message)

    ros.until(lambda: "none came: the rig's own camera" in (state.value('camera_info') or ''))
    # Once it comes, from a reliable publisher, the warning ends.
    info = ros.publisher(CameraInfo, 'camera/camera_info')
    size = rig.camera.width, rig.camera.height
    info.publish(camera_info_message(rig.camera, size, stamp_ns, 'eye'))
    state.shows('camera_info', 'comes')

    def heard():
        infos = ros.node.get_subscriptions_info_by_topic(name)
        return [ReliabilityPolicy(info.qos_profile.reliability).name for info in infos]

    assert heard() == ['BEST_EFFORT']
    says('published with best effort')
    ros.node.destroy_publisher(camera)
    for _ in range(2):
        ros.publisher(Image, 'camera/image_raw', IMAGES)
    ros.until(lambda: heard() == ['RELIABLE'])
    says('camera/image_raw has 2 publishers, whose messages mix')
