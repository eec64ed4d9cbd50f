"""Message types: their definitions, their hashes, and their content without ROS.

`rosbags` knows the common interfaces. Here is what finds the definitions of other packages, so
that a topic of any type is recorded whole.
"""

from __future__ import annotations

import os
import re
from functools import cache
from pathlib import Path
from typing import Any

from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from ftp_dent_ros.errors import BagError
from ftp_dent_ros.recording.topic import Definition

# rosbag2 sets the definitions that a definition needs apart with this line.
_SEPARATOR = '=' * 80
_PRIMITIVES = re.compile(r'(bool|byte|char|float\d+|u?int\d+|w?string)\b')


@cache
def typestore() -> Typestore:
    """All of Jazzy's common interfaces, from the library `rosbags`."""
    return get_typestore(Stores.ROS2_JAZZY)


def type_hash(type_name: str) -> str:
    """REP 2016's hash of a type of Jazzy's common interfaces, '' if it is none of those."""
    return typestore().hash_rihs01(type_name) if type_name in typestore().fielddefs else ''


def find_definition(type_name: str, recorded_hash: str = '') -> Definition:
    """Definition of a message type, with those of all types that it contains.

    Jazzy's common interfaces are known; others are looked up in the ``.msg`` files of the
    sourced ROS workspaces.

    Parameters
    ----------
    type_name : str
        As in ``sensor_msgs/msg/Image``.
    recorded_hash : str, optional
        Hash that the publisher announced: where it differs from the known type's, the known
        definition would be a wrong one.

    Returns
    -------
    Definition
        An empty one if the type is not to be found.
    """
    known_hash = type_hash(type_name)
    if known_hash and recorded_hash in ('', known_hash):
        return Definition('ros2msg', typestore().generate_msgdef(type_name, ros_version=2)[0])
    text = _installed_text(type_name)
    return Definition('ros2msg', text) if text else Definition()


def deserialise(data: bytes, type_name: str, definition: Definition | None = None) -> Any:
    """Content of a serialised (CDR) message, its arrays as numpy arrays.

    Parameters
    ----------
    data : bytes
        As recorded.
    type_name : str
        As in ``sensor_msgs/msg/Image``.
    definition : Definition, optional
        Needed for types that are not among Jazzy's common interfaces.

    Raises
    ------
    BagError
        The type is not known, or the data are not of that type.
    """
    store = typestore()
    try:
        if type_name not in store.fielddefs and definition is not None and definition.text:
            store.register(get_types_from_msg(definition.text, type_name))
        return store.deserialize_cdr(data, type_name)
    except KeyError:
        raise BagError(
            f'the message type {type_name} is unknown: read it where its package is installed'
        ) from None
    except Exception as reason:  # the library's own, of several kinds
        raise BagError(f'a message is no {type_name} ({reason}): the bag is damaged') from None


def _installed_text(type_name: str) -> str:
    """A definition and those that it needs, as rosbag2 puts them together; '' if not found."""
    texts: dict[str, str] = {}
    missing = [type_name]
    while missing:
        name = missing.pop(0)
        if name in texts:
            continue
        package, *_, message = name.split('/')
        path = _message_file(package, message)
        if path is None:
            return ''
        texts[name] = path.read_text(encoding='utf-8')
        missing += _contained_types(texts[name], package)
    first, *others = texts.items()
    parts = [first[1], *(f'{_SEPARATOR}\nMSG: {_short(name)}\n{text}' for name, text in others)]
    return '\n'.join(parts)


def _message_file(package: str, message: str) -> Path | None:
    prefixes = filter(None, os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep))
    paths = (Path(prefix, 'share', package, 'msg', f'{message}.msg') for prefix in prefixes)
    return next((path for path in paths if path.is_file()), None)


def _contained_types(text: str, package: str) -> list[str]:
    names = []
    for line in text.splitlines():
        words = line.split('#')[0].split()
        if len(words) < 2 or _PRIMITIVES.match(words[0]):
            continue
        name = words[0].split('[')[0]
        package_of, _, message = name.rpartition('/')
        names.append(f'{(package_of or package).split("/")[0]}/msg/{message}')
    return names


def _short(name: str) -> str:
    package, *_, message = name.split('/')
    return f'{package}/{message}'
