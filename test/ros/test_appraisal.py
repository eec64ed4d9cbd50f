"""What is lost on the way is told from what a slow machine did not do."""

import pytest

pytest.importorskip('mcap', reason='the demonstration records a bag')

from rclpy.serialization import serialize_message
from sensor_msgs.msg import Image

from ftp_dent_ros.demonstration.appraisal import TYPES, appraise
from ftp_dent_ros.recording.reader import open_bag
from ftp_dent_ros.recording.topic import Message, Qos, RecordedTopic, find_definition, type_hash
from ftp_dent_ros.recording.writer import BagWriter
from ftp_dent_ros.ros.messages import make_header
from ftp_dent_ros.simulation.world import read_world


def message_name(kind):
    package, _, _ = kind.__module__.partition('.')
    return f'{package}/msg/{kind.__name__}'


@pytest.mark.parametrize(
    ('halves', 'counts', 'lost', 'not_taken'),
    [
        ([0, 1, 2, 3], [1, 2, 3, 4], 0, 0),
        ([0, 1, 3, 6], [1, 2, 3, 4], 0, 3),
        ([0, 1, 3, 4], [1, 2, 4, 5], 1, 0),
        ([0, 1, 3, 6], [1, 2, 4, 5], 1, 2),
    ],
)
def test_lost_or_not_taken(tmp_path, halves, counts, lost, not_taken):
    names = {topic: message_name(kind) for topic, kind in TYPES.items()}
    camera = '/camera/image_raw'
    with BagWriter(tmp_path / 'bag') as writer:
        for topic, name in names.items():
            hash_ = type_hash(name)
            writer.add_topic(
                RecordedTopic(topic, name, hash_, (Qos(),), find_definition(name, hash_))
            )
        for half, count in zip(halves, counts, strict=True):
            stamp_ns = half * 500_000_000
            data = serialize_message(Image(header=make_header(stamp_ns, 'camera')))
            writer.write([Message(camera, names[camera], stamp_ns, stamp_ns, data, count)])
    world = read_world('shipped:scene.yaml', 0)
    found = appraise(open_bag(tmp_path / 'bag'), world, image_rate=2.0, pose_rate=50.0)
    assert (found.images, found.images_lost, found.images_not_taken) == (4, lost, not_taken)
