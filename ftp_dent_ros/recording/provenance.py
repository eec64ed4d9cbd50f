"""Which rig measured what a bag holds."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from ftp_dent_ros.recording.reader import Bag

#: Name of the rig's id, in a bag's custom data as in the diagnostics of ``reconstruction``.
RIG = 'rig'
NO_RIG = 'none'
_DIAGNOSTICS = 'diagnostic_msgs/msg/DiagnosticArray'


def rig_id_in(array: Any) -> str:
    """Id of the rig in a diagnostic_msgs/DiagnosticArray; empty if it tells none."""
    for status in array.status:
        for value in status.values:
            if value.key == RIG and value.value not in ('', NO_RIG):
                return str(value.value)
    return ''


def rig_id_of(bag: Bag) -> str:
    """Id of the rig that measured a bag's clouds; empty if the bag does not say it.

    The recorder writes it into the metadata. What was recorded of the diagnostics tells it too,
    where the recorder was killed.
    """
    told = bag.metadata.custom_data.get(RIG, '')
    return told or next(filter(None, map(rig_id_in, diagnostics_of(bag))), '')


def diagnostics_of(bag: Bag) -> Iterator[Any]:
    """What was recorded of the diagnostics: diagnostic_msgs/DiagnosticArray, in order."""
    topics = [topic.name for topic in bag.metadata.topics if topic.type == _DIAGNOSTICS]
    for message in bag.messages(topics) if topics else ():
        if message.type == _DIAGNOSTICS:
            yield bag.deserialise(message)
