"""Pattern, simulated camera and reconstruction, each a process: from the pattern to the cloud."""

from __future__ import annotations

import numpy as np
import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticStatus
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from std_srvs.srv import Trigger

from ftp_dent_ros.files import find
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.profilometry import Reconstructor, Settings
from ftp_dent_ros.ros.messages import cloud_from_message, photograph_from_message, stamp_to_ns
from ftp_dent_ros.ros.qos import PATTERNS
from ftp_dent_ros.simulation.world import read_world

PATTERN = Pattern(320, 200, 8.0, 159.5)
START_NS = 1_763_000_000_000_000_000


@pytest.fixture
def world():
    return read_world('shipped:scene.yaml', START_NS)


@pytest.fixture(params=['rgb8', 'bayer_gbrg12'])
def scene_file(request, tmp_path):
    """The shipped scene by a camera that gives colours, and by one that gives raw pixels."""
    scene = yaml.safe_load(find('shipped:scene.yaml').read_text())
    scene['photometry']['encoding'] = request.param
    (tmp_path / 'scene.yaml').write_text(yaml.safe_dump(scene))
    return tmp_path / 'scene.yaml'


def start_camera(ros, rig_file, **parameters):
    return ros.start(
        'camera_capture',
        source='simulation',
        rig=rig_file,
        simulation__start_ns=START_NS,
        **parameters,
    )


def test_photographs_of_the_simulated_skin_become_clouds_on_it(ros, rig, rig_file, scene_file):
    world = read_world(scene_file, START_NS)
    images = ros.collect(Image, 'camera/image_raw')
    infos = ros.collect(CameraInfo, 'camera/camera_info')
    clouds = ros.collect(PointCloud2, 'points')
    processes = [
        ros.start('reconstruction', rig=rig_file),
        ros.start('pattern_publisher', rig=rig_file, period_px=8),
    ]
    ros.until(lambda: ros.node.count_subscribers('camera/image_raw') == 2)
    scene = str(scene_file)
    processes.append(start_camera(ros, rig_file, rate=2, simulation__scene=scene))
    taken = {}

    def pictured(message):
        taken.update((stamp_to_ns(image.header.stamp), image) for image in images)
        return stamp_to_ns(message.header.stamp) in taken

    # Who subscribes a moment late misses a message or two.
    ros.until(lambda: infos and len(list(filter(pictured, clouds))) >= 3)
    projected = PATTERN.draw()
    photographs = {at: photograph_from_message(image) for at, image in taken.items()}
    for info in infos:
        stamp_ns = stamp_to_ns(info.header.stamp)
        assert stamp_ns not in taken or info.header == taken[stamp_ns].header
    stamps = list(photographs)
    expected, seen = world.photograph(rig, projected, stamps[0]), photographs[stamps[0]]
    assert seen.mosaic == expected.mosaic
    filling = 16 if seen.white > 255 else 8
    np.testing.assert_array_equal(seen.pixels >> (filling - expected.bits), expected.pixels)
    assert stamps == sorted(set(stamps))
    reconstructor = Reconstructor(rig, PATTERN, Settings())
    for message in list(filter(pictured, clouds))[:3]:
        stamp_ns = stamp_to_ns(message.header.stamp)
        assert message.header.frame_id == 'camera_optical_frame'
        cloud = cloud_from_message(message)
        again = reconstructor.reconstruct(photographs[stamp_ns])
        np.testing.assert_array_equal(cloud.points, again.points)
        in_map = world.camera_pose(stamp_ns).apply(cloud.points[cloud.valid])
        assert cloud.valid.mean() > 0.5
        assert np.abs(world.surface.distance(in_map)).mean() < 0.5e-3
    assert [process.stop() for process in processes] == [0, 0, 0]


def test_a_pattern_that_changes_in_flight_never_makes_a_wrong_cloud(ros, rig_file, world):
    patterns = ros.collect(Image, 'projector/image_raw', PATTERNS)
    clouds = ros.collect(PointCloud2, 'points')
    processes = [
        ros.start('reconstruction', rig=rig_file, stride=4),
        ros.start('pattern_publisher', rig=rig_file, period_px=8),
        start_camera(ros, rig_file, rate=8),
    ]
    ros.until(lambda: patterns and clouds)
    for number, period in enumerate((10.0, 7.0, 11.0, 8.0), start=2):
        parameter = Parameter('period_px', value=period).to_parameter_msg()
        request = SetParameters.Request(parameters=[parameter])
        ros.call(SetParameters, 'pattern_publisher/set_parameters', request)
        ros.until(lambda number=number: len(patterns) == number)
        change_ns = stamp_to_ns(patterns[-1].header.stamp)
        ros.until(lambda after=change_ns: stamp_to_ns(clouds[-1].header.stamp) > after)
    changes = [stamp_to_ns(pattern.header.stamp) for pattern in patterns]
    for message in clouds:
        stamp_ns = stamp_to_ns(message.header.stamp)
        assert min(abs(stamp_ns - change) for change in changes) >= 250_000_000
        cloud = cloud_from_message(message)
        in_map = world.camera_pose(stamp_ns).apply(cloud.points[cloud.valid])
        assert np.abs(world.surface.distance(in_map)).mean() < 0.5e-3
    assert [process.stop() for process in processes] == [0, 0, 0]


def test_without_a_pattern_the_simulated_camera_says_what_to_do(ros, rig_file):
    process = start_camera(ros, rig_file, rate=0)
    response = ros.call(Trigger, 'camera_capture/capture', Trigger.Request())
    assert not response.success and 'start pattern_publisher' in response.message
    state = ros.diagnostics('camera_capture')
    ros.until(lambda: state() and state().level == DiagnosticStatus.ERROR)
    assert 'nothing is projected yet' in state().message
    ros.start('pattern_publisher', rig=rig_file, period_px=8)
    images = ros.collect(Image, 'camera/image_raw')
    ros.met_by('camera_capture')
    ros.until(lambda: ros.call(Trigger, 'camera_capture/capture', Trigger.Request()).success)
    ros.until(lambda: images)
    assert process.stop() == 0
