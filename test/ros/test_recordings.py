"""Recordings on the drone, by the real recorder."""

import pytest

pytest.importorskip('mcap', reason='mcap is not installed: nothing is recorded')

from ftp_dent_ros.ground.commands import Recordings


def test_one_at_a_time_begun_ended_and_told(ros, tmp_path):
    from std_msgs.msg import String

    publisher = ros.node.create_publisher(String, 'hello', 10)
    said = []
    recordings = Recordings(tmp_path / 'bags', said.append)
    try:
        assert recordings.state == 'not recording'
        assert not recordings.stop().success
        begun = recordings.start()
        assert begun.success and str(tmp_path) in begun.message
        assert not recordings.start().success
        assert recordings.state.startswith('recording to')
        ros.until(publisher.get_subscription_count)
        publisher.publish(String(data='hello'))
        ended = recordings.stop()
        assert ended.success and 'topics' in ended.message, said
        (bag,) = (tmp_path / 'bags').iterdir()
        assert (bag / 'metadata.yaml').is_file()
    finally:
        recordings.close()


def test_a_folder_that_cannot_be_is_told(ros, tmp_path):
    (tmp_path / 'file').write_text('')
    recordings = Recordings(tmp_path / 'file', print)
    try:
        answer = recordings.start()
        assert not answer.success and 'could not begin' in answer.message
        assert recordings.state == 'not recording'
    finally:
        recordings.close()


def test_a_compressed_recording_reads_as_what_was_published(ros, rig, tmp_path):
    import signal
    import subprocess
    import sys

    import numpy as np
    from sensor_msgs.msg import CameraInfo, PointCloud2

    from ftp_dent_ros.cloud.cloud import Cloud
    from ftp_dent_ros.coding.cloud_codec import RayGrid
    from ftp_dent_ros.coding.messages import cloud_from_message
    from ftp_dent_ros.recording.reader import open_bag
    from ftp_dent_ros.ros.messages import camera_info_message, cloud_to_message
    from ftp_dent_ros.ros.qos import CLOUDS

    view = RayGrid(rig.camera, 2)
    depth = 0.7 + 0.05 * view.rays()[0]
    cloud = Cloud(np.stack([*view.rays() * depth, depth], axis=2), np.full(view.shape, 20, 'f4'))
    infos = ros.node.create_publisher(CameraInfo, 'camera_info', CLOUDS)
    points = ros.node.create_publisher(PointCloud2, 'points', CLOUDS)
    bag = tmp_path / 'bag'
    topics = [f'{ros.namespace}/{name}' for name in ('camera_info', 'points')]
    words = ['-m', 'ftp_dent_ros.cli.main', 'record', '--compress', '-o', str(bag), *topics]
    process = subprocess.Popen([sys.executable, *words])
    try:
        ros.until(lambda: infos.get_subscription_count() and points.get_subscription_count())
        infos.publish(camera_info_message(rig.camera, (400, 260), 5, 'camera'))
        for stamp in range(3):
            points.publish(cloud_to_message(cloud, stamp, 'camera'))
        assert points.wait_for_all_acked()
    finally:
        process.send_signal(signal.SIGINT)
        assert process.wait(60) == 0
    read = open_bag(bag)
    messages = list(read.messages([topics[1]]))
    assert len(messages) == 3 and read.coded
    assert sum(path.stat().st_size for path in read.files) < cloud.points.nbytes / 5
    back = cloud_from_message(read.deserialise(messages[0]))
    np.testing.assert_allclose(back.points, cloud.points, atol=1e-6)
