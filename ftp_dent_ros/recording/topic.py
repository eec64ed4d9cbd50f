"""What a bag holds: messages, and topics with their type and quality of service.

A replayed topic has the quality of service that it was recorded with, as ``ros2 bag`` does it; the
libraries keep the text alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import lru_cache
from typing import Any, NamedTuple

import yaml

INFINITE_NS = 2**63 - 1  # rmw's duration that never ends
_SECOND_NS = 10**9
# Of topics that hold another one's messages compressed (`compression`): clouds, and pictures.
SUFFIXES = ('/coded_cloud', '/coded_image')
_DURATIONS = ('deadline', 'lifespan', 'liveliness_lease_duration')

# rmw/types.h, in the order of its enumerations.
_POLICIES = {
    'history': ('system_default', 'keep_last', 'keep_all', 'unknown'),
    'reliability': ('system_default', 'reliable', 'best_effort', 'unknown', 'best_available'),
    'durability': ('system_default', 'transient_local', 'volatile', 'unknown', 'best_available'),
    'liveliness': (
        'system_default',
        'automatic',
        'unknown',
        'manual_by_topic',
        'unknown',
        'best_available',
    ),
}


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


@dataclass(frozen=True)
class Qos:
    """Quality of service that a publisher offered, in the words of rmw and of rosbag2.

    Discovery does not tell a publisher's history, hence 'unknown' and depth 0. Durations are in
    nanoseconds.
    """

    history: str = 'unknown'
    depth: int = 0
    reliability: str = 'reliable'
    durability: str = 'volatile'
    deadline: int = INFINITE_NS
    lifespan: int = INFINITE_NS
    liveliness: str = 'automatic'
    liveliness_lease_duration: int = INFINITE_NS
    avoid_ros_namespace_conventions: bool = False


@dataclass(frozen=True)
class Definition:
    """The text that defines a message type: `encoding` is 'ros2msg', or '' for none."""

    encoding: str = ''
    text: str = ''


@dataclass(frozen=True)
class Topic:
    """A topic as it was recorded.

    Attributes
    ----------
    name, type : str
        As in ``/camera/image_raw`` and ``sensor_msgs/msg/Image``.
    type_hash : str
        REP 2016's ``RIHS01_...`` of the type, or '' where it is not known.
    offered_qos : tuple of Qos
        One for each publisher that there was when the recording of the topic began.
    definition : Definition
        Of the type and all that it contains.
    """

    name: str
    type: str
    type_hash: str = ''
    offered_qos: tuple[Qos, ...] = ()
    definition: Definition = Definition()


def qos_to_list(profiles: Sequence[Qos]) -> list[dict[str, Any]]:
    """``offered_qos_profiles`` as version 9 has it: policies by name, durations split."""
    return [
        {field.name: _split(field.name, getattr(qos, field.name)) for field in fields(Qos)}
        for qos in profiles
    ]


def qos_to_yaml(profiles: Sequence[Qos]) -> str:
    """``offered_qos_profiles`` as text, as MCAP's channels hold it."""
    return yaml.safe_dump(qos_to_list(profiles), sort_keys=False).strip()


def qos_from(value: object) -> tuple[Qos, ...]:
    """Read ``offered_qos_profiles`` back, from text or list, with names or rmw's numbers.

    Up to version 8 policies are numbers and the list is text within the text.
    """
    profiles: Any = _parsed(value) if isinstance(value, str) else value
    return tuple(
        Qos(**{field.name: _joined(field.name, profile[field.name]) for field in fields(Qos)})
        for profile in profiles or ()
    )


@lru_cache(maxsize=64)
def _parsed(text: str) -> Any:
    """What profiles say as text: the topics of a bag have few different ones."""
    return yaml.safe_load(text)


def _split(name: str, value: Any) -> Any:
    if name not in _DURATIONS:
        return value
    return {'sec': value // _SECOND_NS, 'nsec': value % _SECOND_NS}


def _joined(name: str, value: Any) -> Any:
    if name in _DURATIONS:
        return min(value['sec'] * _SECOND_NS + value['nsec'], INFINITE_NS)
    if name in _POLICIES and isinstance(value, int):
        return _POLICIES[name][value]
    return value
