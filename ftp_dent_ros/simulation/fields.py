"""The fields of a scene file, each checked as it is read."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any, TypeVar

from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.pose import Pose

T = TypeVar('T')


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

    def number(self, name: str, default: float | None = None) -> float:
        """A finite number."""
        return self._as_number(name, self._take(name, default))

    def numbers(self, name: str, count: int, default: Any = None) -> tuple[float, ...]:
        """A list of `count` finite numbers."""
        value = self._take(name, default)
        if not isinstance(value, (list, tuple)) or len(value) != count:
            raise self.error(name, value, f'a list of {count} numbers')
        return tuple(self._as_number(name, entry) for entry in value)

    def whole(self, name: str, default: int | None = None) -> int:
        """A whole number that is not negative."""
        value = self._take(name, default)
        if not isinstance(value, int) or isinstance(value, bool) or value < 0:
            raise self.error(name, value, 'a whole number that is not negative')
        return value

    def flag(self, name: str, default: bool | None = None) -> bool:
        """True or false."""
        value = self._take(name, default)
        if not isinstance(value, bool):
            raise self.error(name, value, 'true or false')
        return value

    def text(self, name: str, default: str | None = None) -> str:
        """A text that is not empty."""
        value = self._take(name, default)
        if not isinstance(value, str) or not value:
            raise self.error(name, value, 'a text')
        return value

    def choice(self, name: str, choices: Mapping[str, T], default: str | None = None) -> T:
        """What one of the choices stands for."""
        value = self._take(name, default)
        if not isinstance(value, str) or value not in choices:
            raise self.error(name, value, f'one of {", ".join(choices)}')
        return choices[value]

    def series(self, name: str, default: Any = None) -> tuple[float, ...]:
        """A list of one finite number or more."""
        value = self._take(name, default)
        if not isinstance(value, (list, tuple)) or not value:
            raise self.error(name, value, 'a list of numbers')
        return tuple(self._as_number(name, entry) for entry in value)

    def tint(self, name: str, default: Any = None) -> tuple[float, float, float]:
        """A factor on an albedo: one number that is not negative, or three."""
        value = self._take(name, default)
        parts = value if isinstance(value, (list, tuple)) else [value] * 3
        if len(parts) != 3 or not all(self._as_number(name, part) >= 0 for part in parts):
            raise self.error(name, value, 'one or three numbers that are not negative')
        red, green, blue = map(float, parts)
        return red, green, blue

    def record(self, kind: type[T]) -> T:
        """A dataclass of plain fields, each read by its name and type."""
        values: dict[str, Any] = {}
        for field in dataclasses.fields(kind):  # type: ignore[arg-type]
            default = None if field.default is dataclasses.MISSING else field.default
            values[field.name] = self._of_type(str(field.type), field.name, default)
        self.finish()
        return kind(**values)

    def _of_type(self, kind: str, name: str, default: Any) -> Any:
        if kind == 'tuple[float, float, float]':
            return self.numbers(name, 3, default)
        read: dict[str, Callable[[str, Any], Any]] = {
            'float': self.number,
            'int': self.whole,
            'bool': self.flag,
            'str': self.text,
            'Colour': self.tint,
            'tuple[float, ...]': self.series,
        }
        return read[kind](name, default)

    def colour(self, name: str, default: Any) -> tuple[float, float, float]:
        """An albedo: one number from 0 to 1, or three for red, green and blue."""
        value = self._take(name, default)
        parts = value if isinstance(value, (list, tuple)) else [value] * 3
        if len(parts) != 3 or not all(0 <= self._as_number(name, part) <= 1 for part in parts):
            raise self.error(name, value, 'one or three numbers from 0 to 1')
        red, green, blue = map(float, parts)
        return red, green, blue

    def pose(self, name: str, default: Any = None) -> Pose:
        """A block with `translation` (metres) and `rpy` (roll, pitch, yaw, radians: REP 103)."""
        block = self.block(name, default)
        pose = Pose.from_rpy(block.numbers('rpy', 3), block.numbers('translation', 3))
        block.finish()
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

    def rest(self) -> dict[str, Any]:
        """All fields that have not been read, as they are."""
        values, self._values = self._values, {}
        return values

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

    def _as_number(self, name: str, value: Any) -> float:
        number = isinstance(value, (int, float)) and not isinstance(value, bool)
        if not number or not math.isfinite(value):
            raise self.error(name, value, 'a finite number')
        return float(value)


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
