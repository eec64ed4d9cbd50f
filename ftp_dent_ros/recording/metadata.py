"""What a bag says about itself: its files, its topics, ``metadata.yaml``.

The layout is version 9 of rosbag2's (ROS 2 Jazzy): one mapping ``rosbag2_bagfile_information``.
The writer of `rosbags` writes it of a single file only.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from ftp_dent_ros.errors import BagError
from ftp_dent_ros.files import written_aside
from ftp_dent_ros.recording.topic import Topic, qos_from, qos_to_list
from ftp_dent_ros.yaml_file import read_yaml

VERSION = 9
METADATA_FILE = 'metadata.yaml'

# rosbag2 gives a bag without messages this starting time.
NO_TIME_NS = 2**63 - 1


@dataclass(frozen=True)
class BagFile:
    """One file of a bag: its name in the bag's folder, and its part of the time."""

    path: str
    start_ns: int
    duration_ns: int
    message_count: int


@dataclass(frozen=True)
class BagMetadata:
    """All that ``metadata.yaml`` holds.

    A topic's name is there twice if messages of two types were recorded of it.
    """

    files: tuple[BagFile, ...]
    topics: tuple[Topic, ...]
    message_counts: Mapping[str, int]
    ros_distro: str = ''
    custom_data: Mapping[str, str] = field(default_factory=dict)

    @property
    def message_count(self) -> int:
        """Number of messages in all files."""
        return sum(file.message_count for file in self.files)

    @property
    def start_ns(self) -> int:
        """Log time of the first message, in ns since the epoch (`NO_TIME_NS` if none)."""
        return min((file.start_ns for file in self.files), default=NO_TIME_NS)

    @property
    def duration_ns(self) -> int:
        """Time from the first message to the last."""
        ends = [file.start_ns + file.duration_ns for file in self.files if file.message_count]
        return max(ends) - self.start_ns if ends else 0


def distribution() -> str:
    """Name of the ROS distribution; 'jazzy' where none is sourced, for its wheels are."""
    return os.environ.get('ROS_DISTRO') or 'jazzy'


def metadata_to_mapping(metadata: BagMetadata) -> dict[str, Any]:
    """Content of ``rosbag2_bagfile_information``, in the order that rosbag2 writes."""
    return {
        'version': VERSION,
        'storage_identifier': 'mcap',
        'duration': {'nanoseconds': metadata.duration_ns},
        'starting_time': {'nanoseconds_since_epoch': metadata.start_ns},
        'message_count': metadata.message_count,
        'topics_with_message_count': [
            {
                'topic_metadata': {
                    'name': topic.name,
                    'type': topic.type,
                    'serialization_format': 'cdr',
                    'offered_qos_profiles': qos_to_list(topic.offered_qos),
                    'type_description_hash': topic.type_hash,
                },
                'message_count': metadata.message_counts.get(topic.name, 0),
            }
            for topic in metadata.topics
        ],
        'compression_format': '',
        'compression_mode': '',
        'relative_file_paths': [file.path for file in metadata.files],
        'files': [
            {
                'path': file.path,
                'starting_time': {'nanoseconds_since_epoch': file.start_ns},
                'duration': {'nanoseconds': file.duration_ns},
                'message_count': file.message_count,
            }
            for file in metadata.files
        ],
        'custom_data': dict(metadata.custom_data) or None,
        'ros_distro': metadata.ros_distro,
    }


def metadata_to_yaml(mapping: Mapping[str, Any]) -> str:
    """YAML as rosbag2's reader takes it: block style, no anchors."""
    return yaml.dump(mapping, Dumper=_Dumper, sort_keys=False, width=1000)


def write_metadata(folder: Path, metadata: BagMetadata) -> None:
    """Write ``metadata.yaml``: from then on the folder is a whole bag."""
    text = metadata_to_yaml({'rosbag2_bagfile_information': metadata_to_mapping(metadata)})
    with written_aside(folder / METADATA_FILE) as path:
        path.write_text(text, encoding='utf-8')


def read_metadata(folder: Path) -> BagMetadata:
    """Read ``metadata.yaml``, of this version or of an older one (from 5: Humble's).

    Raises
    ------
    BagError
        It is malformed, or the bag is stored in a way that is not read here.
    """
    path = folder / METADATA_FILE
    data = read_yaml(path, BagError)
    try:
        information = data['rosbag2_bagfile_information']
        storage, mode = information['storage_identifier'], information.get('compression_mode', '')
        if storage != 'mcap' or mode not in ('', 'NONE', 'none'):
            raise BagError(
                f'{folder}: stored as {storage} {mode}'.rstrip()
                + ', and only MCAP is read here: convert it with `ros2 bag convert`'
            )
        entries = information['topics_with_message_count']
        topics = tuple(_topic(entry['topic_metadata']) for entry in entries)
        return BagMetadata(
            files=tuple(_file(entry) for entry in information['files']),
            topics=topics,
            message_counts={
                topic.name: int(entry['message_count'])
                for topic, entry in zip(topics, entries, strict=True)
            },
            ros_distro=str(information.get('ros_distro') or ''),
            custom_data=_texts(information.get('custom_data') or {}),
        )
    except (KeyError, TypeError, ValueError, AttributeError, IndexError, yaml.YAMLError) as reason:
        raise BagError(
            f'{path}: not a rosbag2 metadata file ({type(reason).__name__}: {reason}): '
            f'make a whole bag of {folder} with `ftp-dent recover`'
        ) from None


def _texts(entry: Mapping[Any, Any]) -> dict[str, str]:
    return {str(name): str(value) for name, value in entry.items()}


def _topic(entry: Mapping[str, Any]) -> Topic:
    return Topic(
        name=str(entry['name']),
        type=str(entry['type']),
        type_hash=str(entry.get('type_description_hash') or ''),
        offered_qos=qos_from(entry.get('offered_qos_profiles')),
    )


def _file(entry: Mapping[str, Any]) -> BagFile:
    return BagFile(
        path=str(entry['path']),
        start_ns=int(entry['starting_time']['nanoseconds_since_epoch']),
        duration_ns=int(entry['duration']['nanoseconds']),
        message_count=int(entry['message_count']),
    )


class _Dumper(yaml.SafeDumper):
    """Writes equal profiles out each time instead of referring to the first."""

    def ignore_aliases(self, data: object) -> bool:
        return True
