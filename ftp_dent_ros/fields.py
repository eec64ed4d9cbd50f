"""Records of plain data: what a field may be stands in its type, and is checked in one way.

``width: Positive`` of a dataclass that is `Checked` says all there is to say: whoever makes one,
in code or of a file's `Fields`, reads in one sentence what is wrong, where, and what to give.
"""

from __future__ import annotations

import dataclasses
import inspect
import math
from array import array
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from typing import Annotated, Any, ClassVar, TypeVar, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.errors import ConfigurationError, InputError

T = TypeVar('T')
_WORDS = {
    float: 'a finite number',
    int: 'a whole number',
    bool: 'true or false',
    str: 'a text in quotes',
}
# An array is what ROS has a list of numbers in.
_LISTS = (list, tuple, np.ndarray, array)
_TYPES: dict[type, Any] = {int: (int, np.integer), bool: bool, str: str}


@dataclasses.dataclass(frozen=True)
class Limits:
    """What a number, or each of a list of numbers, may be.

    Attributes
    ----------
    low, high, above : float
        The least and the largest; what it has to exceed.
    choices : tuple
        The only values that there are.
    repeats : bool
        One number stands for a whole list of equal ones.
    """

    low: float = -math.inf
    high: float = math.inf
    above: float = -math.inf
    choices: tuple[Any, ...] = ()
    repeats: bool = False

    def allow(self, values: Any) -> bool:
        """Whether all values lie within."""
        if self.choices:
            return all(each in self.choices for each in values)
        if self == Limits():
            return True
        return all(self.low <= each <= self.high and each > self.above for each in values)

    def __str__(self) -> str:
        least = f'above {self.above:g}' if self.above > -math.inf else f'from {self.low:g}'
        if self.high < math.inf:
            return f' {least} to {self.high:g}'
        return f' {least} on' if max(self.low, self.above) > -math.inf else ''


Positive = Annotated[float, Limits(above=0)]
NotNegative = Annotated[float, Limits(0)]
Share = Annotated[float, Limits(0, 1)]
Count = Annotated[int, Limits(0)]
Pixels = Annotated[int, Limits(1, 65536)]
Numbers = tuple[float, ...]
Pair = tuple[float, float]
Triple = tuple[float, float, float]
Quadruple = tuple[float, float, float, float]
Colour = Annotated[Triple, Limits(0, repeats=True)]
Reflectance = Annotated[Triple, Limits(0, 1, repeats=True)]


def is_number(value: Any) -> bool:
    """Whether a value is a finite number, and no truth value."""
    number = isinstance(value, (int, float, np.number)) and not isinstance(value, bool)
    return number and math.isfinite(value)


def conforming(hint: Any, value: Any) -> Any:
    """A value as a field of a type holds it; what no file can say is taken as it is.

    Raises
    ------
    ValueError
        It is none; the message is what to give.
    """
    limits, kind = Limits(), hint
    if get_origin(hint) is Annotated:
        kind, limits = get_args(hint)
    parts = get_args(kind)
    if get_origin(kind) is tuple and parts[0] is float:
        count = 0 if Ellipsis in parts else len(parts)
        words = f'{count or "a list of"} finite numbers'
        if limits.repeats:
            words = f'one or {words}'
            value = [value] * count if is_number(value) else value
        good = isinstance(value, _LISTS) and all(map(is_number, value))
        good = good and 0 < len(value) == (count or len(value)) and limits.allow(value)
        made: Any = tuple(map(float, value)) if good else value
    elif kind in _WORDS:
        words = f'one of {", ".join(map(str, limits.choices))}' if limits.choices else _WORDS[kind]
        good = is_number(value) if kind is float else isinstance(value, _TYPES[kind])
        good = good and isinstance(value, bool) == (kind is bool)
        good = good and limits.allow([value])
        made = float(value) if good and kind is float else value
    else:
        return value
    if not good:
        raise ValueError(f'{words}{limits}')
    return made


@cache
def _hints(kind: Any) -> dict[str, Any]:
    return get_type_hints(kind, include_extras=True)


class Checked:
    """A dataclass whose values are as its fields' types say, or it is not made.

    Raises
    ------
    InputError
        Of the kind `error`: a field's value is none.
    """

    error: ClassVar[type[InputError]] = ConfigurationError

    def __post_init__(self) -> None:
        hints = _hints(type(self))  # type: ignore[arg-type]
        for each in dataclasses.fields(self):  # type: ignore[arg-type]
            value = getattr(self, each.name)
            try:
                conforming(hints[each.name], value)
            except ValueError as expected:
                self.refuse(each.name, str(expected))

    def refuse(self, name: str, expected: str) -> None:
        """Raise the error about a field."""
        raise self.error(f'{name} is {getattr(self, name)!r:.80}: give {expected}')


class Fields:
    """A mapping of a file that knows where it stands in it.

    Parameters
    ----------
    values : object
        Must be a mapping.
    where : str
        What messages begin with: ``scene.yaml: panels[0].``
    error : type
        What is raised, by this and by every method, if a field is missing, unknown or malformed;
        the message names it.
    """

    def __init__(
        self, values: Any, where: str, error: type[InputError] = ConfigurationError
    ) -> None:
        if not isinstance(values, Mapping):
            raise error(f'{where.rstrip(".")} is no mapping of fields: correct it')
        self._values, self._where, self._error = dict(values), where, error

    def __contains__(self, name: str) -> bool:
        return name in self._values

    def take(self, name: str, hint: Any, default: Any = None) -> Any:
        """A value of a type, a record too; the default where there is none."""
        if dataclasses.is_dataclass(hint):
            return self.block(name).record(hint)  # type: ignore[arg-type]
        value = self._take(name, default)
        try:
            return conforming(hint, value)
        except ValueError as expected:
            raise self.refusal(name, value, str(expected)) from None

    def choice(self, name: str, choices: Mapping[str, T], default: str | None = None) -> T:
        """What one of the choices stands for."""
        return choices[self.take(name, Annotated[str, Limits(choices=tuple(choices))], default)]

    def record(self, kind: Callable[..., T], /, **given: Any) -> T:
        """What a dataclass or function makes; nothing is left over.

        Its parameters are `given`, or read by name and type.
        """
        made = self.part(kind, **given)
        self.finish()
        return made

    def part(self, kind: Callable[..., T], /, **given: Any) -> T:
        """What is made of some of the fields, as by `record`."""
        hints = _hints(kind)
        for name, parameter in inspect.signature(kind).parameters.items():
            needed = parameter.default is inspect.Parameter.empty
            if name not in given and (needed or name in self):
                given[name] = self.take(name, hints[name])
        return self.made(kind, **given)

    def made(self, kind: Any, /, *values: Any, **given: Any) -> Any:
        """What a class or function makes; what it refuses by itself does not know of the file."""
        try:
            return kind(*values, **given)
        except InputError as reason:
            raise self._error(f'{self._where}{reason}') from None

    def as_matrix(self, *shape: int) -> NDArray[np.float64]:
        """The block's `data` as a matrix of a shape, which its `rows` and `cols` say."""
        size, data = (self.take('rows', int), self.take('cols', int)), self.take('data', Numbers)
        if size != shape or len(data) != math.prod(shape):
            raise self._error(
                f'{self._where.rstrip(".")} has {len(data)} numbers in rows: {size[0]}, cols: '
                f'{size[1]}: give {math.prod(shape)} in rows: {shape[0]}, cols: {shape[1]}'
            )
        return np.array(data).reshape(shape)

    def block(self, name: str, default: Any = None) -> Fields:
        """A mapping within."""
        return Fields(self._take(name, default), f'{self._where}{name}.', self._error)

    def blocks(self, name: str, default: Any = None) -> Iterator[Fields]:
        """A list of mappings."""
        value = self._take(name, default)
        if not isinstance(value, (list, tuple)):
            raise self.refusal(name, value, 'a list')
        for index, entry in enumerate(value):
            yield Fields(entry, f'{self._where}{name}[{index}].', self._error)

    def finish(self) -> None:
        """Refuse fields that nobody has read."""
        if self._values:
            raise self._error(f'{self._where}{min(map(str, self._values))} is unknown: remove it')

    def refusal(self, name: str, value: Any, expected: str) -> InputError:
        """Error about a value, to raise."""
        return self._error(f'{self._where}{name} is {value!r:.80}: give {expected}')

    def _take(self, name: str, default: Any) -> Any:
        if name not in self._values and default is None:
            raise self._error(f'{self._where}{name} is missing: add it')
        return self._values.pop(name, default)
