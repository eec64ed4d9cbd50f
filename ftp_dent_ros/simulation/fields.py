"""The fields of a scene file, each checked as it is read."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.pose import Pose


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
