"""Small bags to read, cut and damage."""

from collections.abc import Sequence
from pathlib import Path

from ftp_dent_ros.recording.topic import (
    Message,
    Qos,
    RecordedTopic,
    find_definition,
    type_hash,
    typestore,
)
from ftp_dent_ros.recording.writer import BagWriter

STRING = 'std_msgs/msg/String'
POSE = 'geometry_msgs/msg/PoseStamped'
START_NS = 1_700_000_000_000_000_000


def topic(name: str, type_name: str, *qos: Qos) -> RecordedTopic:
    hash_ = type_hash(type_name)
    return RecordedTopic(
        name, type_name, hash_, qos or (Qos(),), find_definition(type_name, hash_)
    )


WORDS = topic('/words', STRING, Qos(), Qos(durability='transient_local'))
POSES = topic('/poses', POSE, Qos(reliability='best_effort'))
SILENT = topic('/silent', STRING)


def string_data(text: str) -> bytes:
    store = typestore()
    return bytes(store.serialize_cdr(store.types[STRING](text), STRING))


def pose_data(seconds: int) -> bytes:
    store = typestore()
    types = store.types
    zero = types['geometry_msgs/msg/Point'](float(seconds), 0.0, 0.0)
    turn = types['geometry_msgs/msg/Quaternion'](0.0, 0.0, 0.0, 1.0)
    stamp = types['builtin_interfaces/msg/Time'](seconds, 0)
    message = types[POSE](
        types['std_msgs/msg/Header'](stamp, 'map'), types['geometry_msgs/msg/Pose'](zero, turn)
    )
    return bytes(store.serialize_cdr(message, POSE))


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
