"""downlink and ground_station as real processes, in two ROS domains."""

import numpy as np
import pytest

pytest.importorskip('zenoh', reason='Zenoh is not installed: the link to the ground is not tested')

from free_address import free_address

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.coding.cloud_codec import RayGrid
from ftp_dent_ros.pose import Pose


@pytest.fixture
def address():
    return free_address()


@pytest.fixture
def ground(ros, domain, tmp_path):
    """A node in the ground's domain; processes that it starts are there too."""
    from ftp_dent_ros.supervision.transport import free_domain

    with free_domain() as other:
        assert other != domain
        folder = tmp_path / 'ground'
        folder.mkdir()
        instance = type(ros)(other, folder)
        yield instance
        instance.close()


def small_cloud(rig, seed):
    view = RayGrid(rig.camera, 4)
    rng = np.random.default_rng(seed)
    depth = 0.7 + 0.05 * rng.random() + 0 * view.rays()[0]
    depth[:5, :9] = np.nan
    points = np.stack([*view.rays() * depth, depth], axis=2).astype('f4')
    return Cloud(points, np.where(np.isfinite(depth), 20, 0).astype('f4'))


def test_topics_and_commands_cross_the_link(
    ros, ground, domain, rig, address, tmp_path, monkeypatch
):
    from diagnostic_msgs.msg import DiagnosticArray
    from geometry_msgs.msg import PoseWithCovarianceStamped
    from nav_msgs.msg import Path
    from sensor_msgs.msg import CameraInfo, CompressedImage, Image, PointCloud2
    from std_srvs.srv import Trigger
    from visualization_msgs.msg import Marker, MarkerArray

    from ftp_dent_ros.ros.messages import (
        camera_info_message,
        cloud_from_message,
        cloud_to_message,
        image_to_message,
        make_header,
        pose_to_message,
        stamp_to_ns,
    )
    from ftp_dent_ros.ros.qos import CLOUDS, IMAGES, LATCHED, POSES

    station = ground.start('ground_station', address=address)
    monkeypatch.setenv('ROS_DOMAIN_ID', str(domain))
    downlink = ros.start('downlink', address=address, spool__folder=tmp_path / 'spool')
    calls = []

    def capture(_, response):
        calls.append(1)
        response.success, response.message = True, 'photograph taken'
        return response

    ros.node.create_service(Trigger, 'camera_capture/capture', capture)
    points = ros.publisher(PointCloud2, 'points', CLOUDS)
    pose = ros.publisher(PoseWithCovarianceStamped, 'tagged/camera_pose', POSES)
    info = ros.publisher(CameraInfo, 'camera/camera_info', IMAGES)
    image = ros.publisher(Image, 'camera/image_raw', IMAGES)
    dents = ros.publisher(PointCloud2, 'dents/list', LATCHED)
    surveyed = ros.publisher(PoseWithCovarianceStamped, 'survey/pose', POSES)
    paths = ros.publisher(Path, 'survey/path', LATCHED)
    coverage = ros.publisher(MarkerArray, 'survey/coverage', LATCHED)
    got = {
        name: ground.collect(kind, name, qos)
        for name, kind, qos in (
            ('points', PointCloud2, CLOUDS),
            ('tagged/points', PointCloud2, CLOUDS),
            ('preview/points', PointCloud2, CLOUDS),
            ('tagged/camera_pose', PoseWithCovarianceStamped, POSES),
            ('camera/image_raw', Image, IMAGES),
            ('camera/camera_info', CameraInfo, IMAGES),
            ('preview/image/compressed', CompressedImage, IMAGES),
            ('dents/list', PointCloud2, LATCHED),
            ('survey/pose', PoseWithCovarianceStamped, POSES),
            ('survey/path', Path, LATCHED),
            ('survey/coverage', MarkerArray, LATCHED),
            ('/diagnostics', DiagnosticArray, 10),
        )
    }
    state = ground.diagnostics('ground_station')
    ground.until(lambda: state() is not None and got['/diagnostics'])

    where = Pose.from_rpy([0.1, 0.2, 0.3], [4.0, 5.0, 6.0])
    stamp = 1_700_000_000_123_456_789
    cloud = small_cloud(rig, 1)
    info.publish(camera_info_message(rig.camera, (400, 260), stamp, 'camera_optical_frame'))
    tagged = PoseWithCovarianceStamped(header=make_header(stamp, 'map'))
    tagged.pose.pose = pose_to_message(where)
    listed = cloud_to_message(cloud, stamp, 'map')

    def both(condition):
        def turn():
            ros.executor.spin_once(timeout_sec=0.01)
            return condition()

        return ground.until(turn)

    ground.met_by('ground_station')
    # Discovery joins publisher and subscriber one after the other.
    both(lambda: info.get_subscription_count() and image.get_subscription_count())
    pose.publish(tagged)
    points.publish(cloud_to_message(cloud, stamp, 'camera_optical_frame'))
    image.publish(image_to_message(np.full((260, 400, 3), 90, np.uint8), stamp, 'camera'))
    dents.publish(listed)
    surveyed.publish(tagged)
    # All of them at once: the newest comes, however little of the link they may take.
    for number in range(1, 4):
        path = Path(header=make_header(number, 'map'))
        paths.publish(path)
    coverage.publish(MarkerArray(markers=[Marker(ns='measured', header=path.header)]))
    both(lambda: all(got[name] for name in got))

    arrived = got['points'][0]
    assert stamp_to_ns(arrived.header.stamp) == stamp
    assert arrived.header.frame_id == 'camera_optical_frame'
    back = cloud_from_message(arrived)
    np.testing.assert_allclose(back.points, cloud.points, atol=1e-6)
    in_map = got['tagged/points'][0]
    assert in_map.header.frame_id == 'map' and stamp_to_ns(in_map.header.stamp) == stamp
    np.testing.assert_allclose(
        cloud_from_message(in_map).points, cloud.transformed(where).points, atol=2e-6
    )
    assert got['tagged/camera_pose'][0] == tagged and got['dents/list'][0] == listed
    assert got['survey/pose'][0] == tagged
    both(lambda: got['survey/path'][-1] == path)
    assert got['survey/coverage'][0].markers[0].ns == 'measured'
    assert abs(int(got['camera/image_raw'][0].data[0]) - 90) < 3
    np.testing.assert_allclose(got['camera/camera_info'][0].k, rig.camera.camera_matrix.ravel())
    assert len(got['points']) == len(got['tagged/points']) == 1

    client = ground.node.create_client(Trigger, 'camera_capture/capture')
    ground.until(client.service_is_ready)
    future = client.call_async(Trigger.Request())
    both(future.done)
    assert future.result().success and future.result().message == 'photograph taken'
    assert calls == [1]
    assert downlink.stop() == 0 and station.stop() == 0


def test_what_no_link_or_page_can_be_made_of_ends_the_nodes(ros, address):
    far = '192.0.2.1:7447'
    processes = [ros.start(name, address=far) for name in ('downlink', 'ground_station')]
    processes += [
        ros.start('ground_station', address=address, web=web)
        for web in ('nowhere', '127.0.0.1:99999')
    ]
    sentences = [*2 * ['without keys'], *2 * ['give another HOST:PORT']]
    for process, sentence in zip(processes, sentences, strict=True):
        assert process.told(sentence), process.output


def test_in_the_payloads_own_domain_the_ground_publishes_nothing(ros, address):
    ros.start('downlink', address=address)
    ros.start('ground_station', address=address)
    state = ros.diagnostics('ground_station')
    ros.until(lambda: 'choose another ROS_DOMAIN_ID' in state.message)
    assert state().level == b'\x02'
