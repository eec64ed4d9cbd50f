"""Parameters that are described, checked, and wrong only with a sentence."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.node import Node
from rclpy.parameter import Parameter

from ftp_dent_ros.errors import ConfigurationError, InputError

_KINDS = {
    bool: 'true or false',
    int: 'a whole number',
    float: 'a number',
    str: 'a text',
}


class Parameters:
    """The parameters of one node.

    A whole number is taken for a floating point one (``rate:=9``), which rclpy alone refuses.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._checks: dict[str, Callable[[Any], Any]] = {}
        self._listeners: list[Callable[[dict[str, Any]], None]] = []
        node.add_on_set_parameters_callback(self._set)

    def declare(
        self,
        name: str,
        default: Any,
        description: str,
        *,
        minimum: float | None = None,
        maximum: float | None = None,
        choices: Sequence[str] = (),
        changeable: bool = False,
    ) -> Any:
        """Declare a parameter and return its value.

        Parameters
        ----------
        name, default, description
            The type is that of `default`: bool, int, float, str, or a list of floats, whose
            length is then fixed.
        minimum, maximum : float, optional
            Range of a number, both inclusive; of each number of a list.
        choices : sequence of str
            The only values that a text may have.
        changeable : bool
            Whether it can be set while the node runs.

        Raises
        ------
        ConfigurationError
            The value given on the command line or in a file is of another type, out of its
            range, or none of the choices.
        """

        def check(value: Any) -> Any:
            return _checked(name, value, default, minimum, maximum, choices)

        flexible = ParameterDescriptor(dynamic_typing=True)
        value = check(self._node.declare_parameter(name, default, flexible).value)
        self._node.undeclare_parameter(name)
        descriptor = ParameterDescriptor(description=description, read_only=not changeable)
        if choices:
            descriptor.additional_constraints = f'One of {", ".join(choices)}.'
        if minimum is not None and maximum is not None:
            if isinstance(default, float):
                descriptor.floating_point_range = [
                    FloatingPointRange(from_value=float(minimum), to_value=float(maximum))
                ]
            elif isinstance(default, int):
                descriptor.integer_range = [
                    IntegerRange(from_value=int(minimum), to_value=int(maximum))
                ]
        self._node.declare_parameter(name, value, descriptor, ignore_override=True)
        self._checks[name] = check
        return value

    def __getitem__(self, name: str) -> Any:
        """Value of a declared parameter; lists are lists of floats."""
        value = self._node.get_parameter(name).value
        return value if isinstance(value, (bool, int, float, str)) else list(value)

    def on_change(self, listener: Callable[[dict[str, Any]], None]) -> None:
        """Call `listener` with the values about to be set, by name.

        An `InputError` that it raises refuses the change, and is the reason that the caller of
        the service reads.
        """
        self._listeners.append(listener)

    def _set(self, parameters: list[Parameter]) -> SetParametersResult:
        values = {item.name: item.value for item in parameters if item.name in self._checks}
        try:
            for name, value in values.items():
                self._checks[name](value)
            for listener in self._listeners if values else ():
                listener(values)
        except InputError as reason:
            return SetParametersResult(successful=False, reason=str(reason))
        return SetParametersResult(successful=True)


def _checked(
    name: str,
    value: Any,
    default: Any,
    minimum: float | None,
    maximum: float | None,
    choices: Sequence[str],
) -> Any:
    """Value in the type of `default`, or a `ConfigurationError`."""
    if isinstance(default, list):
        if isinstance(value, (bool, int, float, str)) or value is None:
            value = [] if value is None else [value]
        if len(value) != len(default):
            raise ConfigurationError(
                f'parameter {name} is {list(value)}: give {len(default)} numbers'
            )
        return [_checked(name, item, 0.0, minimum, maximum, ()) for item in value]
    kind = type(default)
    if kind is float and type(value) is int:
        value = float(value)
    if type(value) is not kind:
        hint = '' if kind is not str else ' in quotes'
        raise ConfigurationError(f'parameter {name} is {value!r}: give {_KINDS[kind]}{hint}')
    if kind is float and not math.isfinite(value):
        raise ConfigurationError(f'parameter {name} is {value}: give a finite number')
    too_low = minimum is not None and value < minimum
    if too_low or (maximum is not None and value > maximum):
        if maximum is None:
            span = f'of at least {minimum:g}'
        elif minimum is None:
            span = f'of at most {maximum:g}'
        else:
            span = f'from {minimum:g} to {maximum:g}'
        raise ConfigurationError(f'parameter {name} is {value}: give a value {span}')
    if choices and value not in choices:
        raise ConfigurationError(f'parameter {name} is {value!r}: give {" or ".join(choices)}')
    return value
