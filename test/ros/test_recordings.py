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
