import numpy as np
import pytest

pytest.importorskip('mcap', reason='mcap is not installed: no bags are tested')
pytest.importorskip('rosbags', reason='rosbags is not installed: no bags are compressed')

from bag_samples import CLOUD, IMAGE, SECOND, cloud_message, data_of, header, image, made, topic
from skins import skin

from ftp_dent_ros.coding.cloud_codec import RayGrid
from ftp_dent_ros.coding.images import image_from_message, photograph_from_message
from ftp_dent_ros.coding.messages import CLOUD_FIELDS, cloud_from_message
from ftp_dent_ros.errors import BagError
from ftp_dent_ros.recording.compression import CompressedBagWriter, decoded
from ftp_dent_ros.recording.reader import open_bag
from ftp_dent_ros.recording.topic import Message, Qos, RecordedTopic
from ftp_dent_ros.rig.rig import Lens

INFO, TEXT = 'sensor_msgs/msg/CameraInfo', 'std_msgs/msg/String'


STAMP_NS = 5 * SECOND + 7


def sent(cloud, frame='camera', names=CLOUD_FIELDS):
    return cloud_message(STAMP_NS, frame, cloud, names)


def image_message(pixels, encoding='rgb8'):
    return image(STAMP_NS, 'camera', pixels, encoding)


def info_message(lens):
    return made(
        INFO,
        header=header(STAMP_NS, 'camera'),
        height=lens.height,
        width=lens.width,
        distortion_model='plumb_bob',
        d=np.asarray(lens.distortion),
        k=lens.camera_matrix.ravel(),
        r=np.eye(3).ravel(),
        p=np.zeros(12),
        binning_x=0,
        binning_y=0,
        roi=made('sensor_msgs/msg/RegionOfInterest', 0, 0, 0, 0, False),
    )


def recorded(folder, messages):
    """Bag of (topic, type, message), compressed."""
    with CompressedBagWriter(folder) as writer:
        for name, kind, _ in messages:
            writer.add_topic(topic(name, kind, Qos('best_effort')))
        writer.write(
            Message(name, kind, 10 + i, 9 + i, data_of(message, kind), i)
            for i, (name, kind, message) in enumerate(messages)
        )
    return open_bag(folder)


def test_names_types_and_contents_come_back(tmp_path, view):
    cloud = skin(view)
    picture = np.random.default_rng(1).integers(90, 110, (90, 160, 3), np.uint8)
    pattern = np.repeat(np.arange(160, dtype=np.uint8)[None, :, None], 90, axis=0).repeat(3, 2)
    raw = np.random.default_rng(2).integers(0, 65536, (90, 160), np.uint16)
    bag = recorded(
        tmp_path / 'bag',
        [
            ('/camera/camera_info', INFO, info_message(view.lens)),
            ('/points', CLOUD, sent(cloud)),
            ('/tagged/points', CLOUD, sent(cloud, 'map')),
            ('/old', CLOUD, sent(cloud, names=CLOUD_FIELDS[:4])),
            ('/camera/image_raw', IMAGE, image_message(picture)),
            ('/projector/image_raw', IMAGE, image_message(pattern)),
            ('/grey', IMAGE, image_message(picture[..., 0].copy(), 'mono8')),
            ('/raw', IMAGE, image_message(raw, 'bayer_grbg16')),
            ('/text', TEXT, made(TEXT, data='as it is')),
        ],
    )
    types = {topic.name: topic.type for topic in bag.topics}
    assert types['/points'] == CLOUD and types['/camera/image_raw'] == IMAGE
    assert types['/text'] == TEXT and len(types) == 9
    assert bag.message_counts == dict.fromkeys(types, 1)
    assert all(topic.offered_qos[0].reliability == 'best_effort' for topic in bag.topics)
    got = {message.topic: bag.deserialise(message) for message in bag.messages()}
    for name, frame in (('/points', 'camera'), ('/tagged/points', 'map')):
        back = cloud_from_message(got[name])
        off = np.linalg.norm(back.points - cloud.points, axis=2)
        assert np.nanmax(off - cloud.sigma / 2) < 2e-7
        assert got[name].header == header(STAMP_NS, frame)
    assert [field.name for field in got['/old'].fields] == list(CLOUD_FIELDS[:4])
    shown = image_from_message(got['/camera/image_raw']).astype(int)
    assert np.abs(shown - picture).mean() < 5
    np.testing.assert_array_equal(image_from_message(got['/projector/image_raw']), pattern)
    np.testing.assert_array_equal(got['/grey'].data, picture[..., 0].ravel())
    np.testing.assert_array_equal(photograph_from_message(got['/raw']).pixels, raw)
    assert got['/raw'].encoding == 'bayer_grbg16'
    assert got['/text'].data == 'as it is'
    (one,) = bag.messages(['/points'])
    assert (one.topic, one.type, one.log_time_ns, one.sequence) == ('/points', CLOUD, 11, 1)


def test_a_bag_is_a_fifteenth_of_its_size(tmp_path, view):
    lens = view.lens
    large = RayGrid(Lens(1280, 720, lens.camera_matrix * [[2], [2], [1]], lens.distortion), 2)
    message = sent(skin(large))
    bag = recorded(
        tmp_path / 'bag',
        [('/camera/camera_info', INFO, info_message(large.lens)), ('/points', CLOUD, message)],
    )
    assert sum(path.stat().st_size for path in bag.files) < len(message.data) / 15


def test_what_is_no_organised_cloud_is_stored_as_it_is(tmp_path, view):
    one_row = sent(skin(view))
    one_row.height, one_row.width = 1, one_row.height * one_row.width
    one_row.row_step = 24 * one_row.width
    bag = recorded(tmp_path / 'bag', [('/dents', CLOUD, one_row)])
    (message,) = bag.messages()
    assert bytes(bag.deserialise(message).data) == bytes(one_row.data) and not bag.coded


def test_what_cannot_be_read_is_stored_as_it_is_and_ends_no_recording(tmp_path):
    kinds = {'/points': CLOUD, '/camera/image_raw': IMAGE, '/camera/camera_info': INFO}
    messages = [
        Message(name, kind, stamp, stamp, data)
        for stamp, data in enumerate((b'', b'\0\1\0\0short', b'\0\1\0\0' + b'\xff' * 60))
        for name, kind in kinds.items()
    ]
    with CompressedBagWriter(tmp_path / 'bag') as writer:
        for name, kind in kinds.items():
            writer.add_topic(RecordedTopic(name, kind))
        writer.write(messages)
    assert list(open_bag(tmp_path / 'bag').messages()) == messages


def test_damage_is_told():
    kind = 'sensor_msgs/msg/CompressedImage'
    coded = made(kind, header(STAMP_NS, 'camera'), '', np.zeros(9, 'u1'))
    for form in ('jpeg', 'ftp_dent_ros cloud 1, 6 fields', 'ftp_dent_ros rgb8, jpeg'):
        coded.format = form
        data = data_of(coded, kind)
        with pytest.raises(BagError):
            decoded(Message('/x/coded_cloud', kind, 1, 1, data), '/x')
