"""The fields of a scene file, each checked as it is read."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping
from typing import Any, TypeVar

from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.pose import Pose

T = TypeVar('T')
# What a field of a dataclass may be, by its annotation, in words.
_KINDS = {
    'float': 'a finite number',
    'int': 'a whole number that is not negative',
    'bool': 'true or false',
    'str': 'a text',
    'Colour': 'one or three numbers that are not negative',
    'tuple[float, ...]': 'a list of numbers',
    'tuple[float, float]': 'a list of 2 numbers',
    'tuple[float, float, float]': 'a list of 3 numbers',
    'tuple[float, float, float, float]': 'a list of 4 numbers',
}


class Fields:
    """A mapping of a configuration file that knows where it stands in it.

    Parameters
    ----------
    values : object
        Must be a mapping.
    where : str
        Path of the mapping, for messages: ``scene.yaml: panels[0]``.

    Raises
    ------
    ConfigurationError
        By this and every method: a field is missing or malformed; the message names it.
    """

    def __init__(self, values: Any, where: str) -> None:
        if not isinstance(values, dict):
            raise ConfigurationError(f'{where}: is no mapping of fields: correct it')
        self._values = dict(values)
        self._where = where

    def __contains__(self, name: str) -> bool:
        return name in self._values

    def take(self, name: str, kind: str, default: Any = None) -> Any:
        """A value of one of `_KINDS`; the default where there is none."""
        value = self._take(name, default)
        if kind == 'Colour' and not isinstance(value, (list, tuple)):
            value = [value] * 3
        if kind in ('int', 'bool', 'str'):
            good = type(value).__name__ == kind and value != ''
            good = good and (kind != 'int' or value >= 0)
        elif kind == 'float':
            good = _is_number(value)
            value = float(value) if good else value
        else:
            count = {'tuple[float, ...]': 0, 'Colour': 3}.get(kind, kind.count('float'))
            good = isinstance(value, (list, tuple)) and bool(value) and all(map(_is_number, value))
            good = good and len(value) in (count, count or len(value))
            good = good and (kind != 'Colour' or min(value) >= 0)
            value = tuple(map(float, value)) if good else value
        if not good:
            raise self.error(name, value, _KINDS[kind])
        return value

    def choice(self, name: str, choices: Mapping[str, T], default: str | None = None) -> T:
        """What one of the choices stands for."""
        value = self._take(name, default)
        if not isinstance(value, str) or value not in choices:
            raise self.error(name, value, f'one of {", ".join(choices)}')
        return choices[value]

    def record(self, kind: type[T], **given: Any) -> T:
        """A dataclass, whose fields are `given` or read by name and type; nothing is left over."""
        values = given | {
            field.name: self.take(
                field.name,
                str(field.type),
                None if field.default is dataclasses.MISSING else field.default,
            )
            for field in dataclasses.fields(kind)  # type: ignore[arg-type]
            if field.name not in given
        }
        self.finish()
        return kind(**values)

    def pose(self, name: str, default: Any = None) -> Pose:
        """A block within that is a pose."""
        return self.block(name, default).as_pose()

    def as_pose(self) -> Pose:
        """The block's `translation` (metres) and `rpy` (roll, pitch, yaw, radians: REP 103)."""
        three = 'tuple[float, float, float]'
        pose = Pose.from_rpy(self.take('rpy', three), self.take('translation', three))
        self.finish()
        return pose

    def block(self, name: str, default: Any = None) -> Fields:
        """A mapping within."""
        return Fields(self._take(name, default), f'{self._where}: {name}')

    def blocks(self, name: str, default: Any = None) -> Iterator[Fields]:
        """A list of mappings."""
        value = self._take(name, default)
        if not isinstance(value, (list, tuple)):
            raise self.error(name, value, 'a list')
        for index, entry in enumerate(value):
            yield Fields(entry, f'{self._where}: {name}[{index}]')

    def finish(self) -> None:
        """Refuse fields that nobody has read."""
        if self._values:
            raise ConfigurationError(
                f'{self._where}: unknown field {min(map(str, self._values))!r}: remove it'
            )

    def error(self, name: str, value: Any, expected: str) -> ConfigurationError:
        """Error about a value, to raise."""
        return ConfigurationError(f'{self._where}: {name} is {value!r}: give {expected}')

    def _take(self, name: str, default: Any) -> Any:
        if name not in self._values and default is None:
            raise ConfigurationError(f'{self._where}: {name} is missing: add it')
        return self._values.pop(name, default)


def _is_number(value: Any) -> bool:
    return type(value) in (int, float) and math.isfinite(value)


def require_positive(part: object, *names: str) -> None:
    """Refuse a part of the world whose lengths of these names are not all positive.

    Raises
    ------
    ConfigurationError
    """
    for name in names:
        if not getattr(part, name) > 0:
            kind = type(part).__name__.lower()
            raise ConfigurationError(
                f'the {name} of a {kind} is {getattr(part, name)!r}: give a positive length'
            )
