"""What a bag holds: messages, and topics with name, type and quality of service."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

import yaml
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from ftp_dent_ros.errors import BagError, ConfigurationError

CODED_TYPE = 'sensor_msgs/msg/CompressedImage'
#: Of topics that hold another one's messages compressed (`compression`), and of which type.
CODED = {
    '/coded_cloud': 'sensor_msgs/msg/PointCloud2',
    '/coded_image': 'sensor_msgs/msg/Image',
}
# rmw's duration that never ends, as rosbag2 writes it.
_INFINITE = {'sec': 9223372036, 'nsec': 854775807}
# rmw/types.h: the numbers that rosbag2 wrote up to version 8.
_RELIABILITIES = {2: 'best_effort', 'best_effort': 'best_effort'}
_DURABILITIES = {1: 'transient_local', 'transient_local': 'transient_local'}
# Of an absolute topic, as ROS 2 takes them.
_NAME = re.compile(r'(/[A-Za-z_][A-Za-z0-9_]*)+')


class Message(NamedTuple):
    """A recorded message: `data` is the serialised (CDR) message as it came over the wire.

    `log_time_ns` is when it was received, `publish_time_ns` when it was published, both in
    nanoseconds since the epoch; `sequence` is its publisher's count.
    """

    topic: str
    type: str
    log_time_ns: int
    publish_time_ns: int
    data: bytes
    sequence: int = 0


class Qos(NamedTuple):
    """What a publisher offered of the policies that decide who hears it, in rosbag2's words."""

    reliability: str = 'reliable'
    durability: str = 'volatile'


@dataclass(frozen=True)
class RecordedTopic:
    """A topic as it was recorded.

    Attributes
    ----------
    name, type : str
        As in ``/camera/image_raw`` and ``sensor_msgs/msg/Image``.
    type_hash : str
        REP 2016's ``RIHS01_...`` of the type, or '' where it is not known.
    offered_qos : tuple of Qos
        One for each publisher that there was when the recording of the topic began.
    definition : str
        Of the type and all that it contains, in the format ``ros2msg``; '' where not known.
    """

    name: str
    type: str
    type_hash: str = ''
    offered_qos: tuple[Qos, ...] = ()
    definition: str = ''


def qos_to_list(profiles: Sequence[Qos]) -> list[dict[str, Any]]:
    """``offered_qos_profiles`` as version 9 of rosbag2's metadata has it."""
    return [
        {
            'history': 'unknown',
            'depth': 0,
            'reliability': qos.reliability,
            'durability': qos.durability,
            'deadline': dict(_INFINITE),
            'lifespan': dict(_INFINITE),
            'liveliness': 'automatic',
            'liveliness_lease_duration': dict(_INFINITE),
            'avoid_ros_namespace_conventions': False,
        }
        for qos in profiles
    ]


def qos_from(text: str) -> tuple[Qos, ...]:
    """Read ``offered_qos_profiles`` of any version; what is malformed offers nothing."""
    try:
        return tuple(
            Qos(
                _RELIABILITIES.get(profile['reliability'], 'reliable'),
                _DURABILITIES.get(profile['durability'], 'volatile'),
            )
            for profile in yaml.safe_load(text) or ()
        )
    except Exception:  # YAML's own, and what comes of values in other places
        return ()


@cache
def typestore() -> Typestore:
    """All of Jazzy's common interfaces, from the library `rosbags`."""
    return get_typestore(Stores.ROS2_JAZZY)


def known_topic(
    name: str, type_name: str, qos: tuple[Qos, ...] = (), announced: str = ''
) -> RecordedTopic:
    """A topic with hash and definition of its type, as far as they are known.

    Parameters
    ----------
    name, type_name : str
    qos : tuple of Qos
        Offered by its publishers.
    announced : str, optional
        Hash that they announce: a definition with another hash would be a wrong one.
    """
    store = typestore()
    known = store.hash_rihs01(type_name) if type_name in store.fielddefs else ''
    definition = ''
    if known and announced in ('', known):
        definition = store.generate_msgdef(type_name, ros_version=2)[0]
    return RecordedTopic(name, type_name, announced or known, qos, definition)


def plain_topic(topic: RecordedTopic) -> RecordedTopic:
    """What a coded topic stands for; any other is itself."""
    for suffix, kind in CODED.items():
        if topic.type == CODED_TYPE and topic.name.endswith(suffix):
            return known_topic(topic.name.removesuffix(suffix), kind, topic.offered_qos)
    return topic


def deserialise(data: bytes, type_name: str, definition: str = '') -> Any:
    """Content of a serialised (CDR) message, its arrays as numpy arrays.

    Parameters
    ----------
    data : bytes
        As recorded.
    type_name : str
        As in ``sensor_msgs/msg/Image``.
    definition : str, optional
        Needed for types that are not among Jazzy's common interfaces.

    Raises
    ------
    BagError
        The type is not known, or the data are not of that type.
    """
    store = typestore()
    try:
        if type_name not in store.fielddefs and definition:
            store.register(get_types_from_msg(definition, type_name))
        return store.deserialize_cdr(data, type_name)
    except KeyError:
        raise BagError(
            f'the message type {type_name} is unknown, and the bag does not describe it'
        ) from None
    except Exception as reason:  # the library's own, of several kinds
        raise BagError(f'a message is no {type_name} ({reason}): the bag is damaged') from None


def absolute_names(names: Iterable[str]) -> tuple[str, ...]:
    """Names of topics, each once; one without a leading slash is taken from the root namespace.

    Raises
    ------
    ConfigurationError
        One is no name of a topic.
    """
    absolute = [name if name.startswith('/') else f'/{name}' for name in names]
    for name in absolute:
        if not _NAME.fullmatch(name):
            raise ConfigurationError(
                f'{name!r} is no name of a topic: give letters, digits, _ and / alone'
            )
    return tuple(dict.fromkeys(absolute))


def is_hidden(name: str) -> bool:
    """Whether ROS hides a topic: a part of the name begins with ``_``."""
    return any(part.startswith('_') for part in name.split('/'))
