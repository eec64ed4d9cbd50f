"""Small bags to read, cut and damage."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.coding.messages import CLOUD_FIELDS
from ftp_dent_ros.recording.topic import Message, Qos, RecordedTopic, known_topic, typestore
from ftp_dent_ros.recording.writer import BagWriter

STRING = 'std_msgs/msg/String'
POSE = 'geometry_msgs/msg/PoseStamped'
IMAGE, CLOUD = 'sensor_msgs/msg/Image', 'sensor_msgs/msg/PointCloud2'
LOCATED = 'geometry_msgs/msg/PoseWithCovarianceStamped'
SECOND = 1_000_000_000
START_NS = 1_700_000_000_000_000_000


def topic(name: str, type_name: str, *qos: Qos) -> RecordedTopic:
    return known_topic(name, type_name, qos or (Qos(),))


WORDS = topic('/words', STRING, Qos(), Qos(durability='transient_local'))
POSES = topic('/poses', POSE, Qos(reliability='best_effort'))
SILENT = topic('/silent', STRING)


def made(type_name: str, *fields, **values):
    """A message of a type."""
    return typestore().types[type_name](*fields, **values)


def serialised(type_name: str, *fields) -> bytes:
    return bytes(typestore().serialize_cdr(made(type_name, *fields), type_name))


def header(stamp_ns: int, frame_id: str):
    stamp = made('builtin_interfaces/msg/Time', stamp_ns // SECOND, stamp_ns % SECOND)
    return made('std_msgs/msg/Header', stamp, frame_id)


def place(position, quaternion):
    """A message of a pose."""
    point = made('geometry_msgs/msg/Point', *map(float, position))
    turn = made('geometry_msgs/msg/Quaternion', *map(float, quaternion))
    return made('geometry_msgs/msg/Pose', point, turn)


def located(stamp_ns: int, pose, covariance) -> bytes:
    """A pose in the map with its covariance, as the bridge sends it."""
    known = made('geometry_msgs/msg/PoseWithCovariance', pose, np.ravel(covariance))
    return serialised(LOCATED, header(stamp_ns, 'map'), known)


def image(stamp_ns: int, frame_id: str, pixels, encoding: str):
    rows, columns = pixels.shape[:2]
    data = np.ascontiguousarray(pixels).reshape(-1).view(np.uint8)
    top = header(stamp_ns, frame_id)
    return made(IMAGE, top, rows, columns, encoding, 0, pixels[0].nbytes, data)


def cloud_message(stamp_ns: int, frame_id: str, cloud: Cloud, names=CLOUD_FIELDS, width=None):
    """A cloud with some of its fields; `width` is what it says of its columns."""
    layers = [cloud.points, *(getattr(cloud, name) for name in names[3:])]
    values = np.dstack(layers).astype('<f4')
    rows, columns, count = values.shape
    fields = [
        made('sensor_msgs/msg/PointField', name, 4 * k, 7, 1) for k, name in enumerate(names)
    ]
    size = (rows, columns if width is None else width)
    data = values.reshape(-1).view(np.uint8)
    step = 4 * count
    return made(
        CLOUD, header(stamp_ns, frame_id), *size, fields, False, step, step * columns, data, False
    )


def data_of(message, type_name: str) -> bytes:
    return bytes(typestore().serialize_cdr(message, type_name))


def string_data(text: str) -> bytes:
    return serialised(STRING, text)


def pose_data(seconds: int) -> bytes:
    return serialised(POSE, header(SECOND * seconds, 'map'), place((seconds, 0, 0), (0, 0, 0, 1)))


ARRAY = 'diagnostic_msgs/msg/DiagnosticArray'
DIAGNOSTICS = topic('/diagnostics', ARRAY)


def diagnostics(seconds: int, **told: str) -> Message:
    """What a node tells of itself."""
    values = [made('diagnostic_msgs/msg/KeyValue', name, value) for name, value in told.items()]
    status = made('diagnostic_msgs/msg/DiagnosticStatus', 0, 'reconstruction', '', '', values)
    data = serialised(ARRAY, header(SECOND * seconds, ''), [status])
    time_ns = START_NS + seconds
    return Message('/diagnostics', ARRAY, time_ns, time_ns, data, seconds)


def sample_messages(count: int) -> list[Message]:
    """Words and poses in turn, 10 ms apart, with words of growing length."""
    messages = []
    for index in range(count):
        time_ns = START_NS + index * 10_000_000
        if index % 2:
            message = Message('/poses', POSE, time_ns, time_ns - 1000, pose_data(index), index)
        else:
            data = string_data(f'{index:4d}' + 'x' * index)
            message = Message('/words', STRING, time_ns, time_ns - 1000, data, index)
        messages.append(message)
    return messages


def write_sample(folder: Path, messages: Sequence[Message], each: int = 3) -> None:
    """A whole bag; `each` messages are handed to the writer at once, and are a chunk."""
    with BagWriter(folder) as writer:
        for known in (WORDS, POSES, SILENT):
            writer.add_topic(known)
        for index in range(0, len(messages), each):
            writer.write(messages[index : index + each])
            writer.sync()
