"""Parameters of a node: described, checked, and wrong only with a sentence."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.node import Node
from rclpy.parameter import Parameter

from ftp_dent_ros import files
from ftp_dent_ros.errors import ConfigurationError, InputError
from ftp_dent_ros.parameters import Declaration, Declarations, undeclared, unknown


class Parameters(Declarations):
    """The parameters of one node.

    A whole number is taken for a floating point one (``rate:=9``), which rclpy alone refuses.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._checks: dict[str, Callable[[Any], Any]] = {}
        self._listeners: list[Callable[[dict[str, Any]], None]] = []
        self._read: list[str] = []
        node.add_on_set_parameters_callback(self._set)

    def take(self, declaration: Declaration) -> Any:
        """As `Declarations.take`."""
        name, check = declaration.name, declaration.checked
        flexible = ParameterDescriptor(dynamic_typing=True)
        value = check(self._node.declare_parameter(name, declaration.default, flexible).value)
        self._node.undeclare_parameter(name)
        self._node.declare_parameter(name, value, _descriptor(declaration), ignore_override=True)
        self._checks[name] = check
        return value

    def path(self, name: str, default: str, description: str) -> str:
        """As `Declarations.path`."""
        return str(self.declare(name, default, description))

    def file(
        self, name: str, default: str, description: str, *, secret: bool = False
    ) -> Path | None:
        """As `Declarations.file`."""
        value = self.declare(name, default, description)
        if not value:
            return None
        try:
            path = files.find(value).resolve()
            what = '' if secret else f' (SHA-256 {files.content_id(path)}...)'
        except ConfigurationError as error:
            raise ConfigurationError(f'parameter {name}: {error}') from None
        self._read.append(f'{name}: {path}{what}')
        return path

    def close(self, of_all_nodes: Callable[[], Sequence[str]]) -> None:
        """End the declarations: refuse what was given and not declared, tell of the files.

        What another node of the package declares may be there for that one, by ``/**``: it is
        only told.

        Parameters
        ----------
        of_all_nodes : callable
            Gives the names that the package's nodes declare.

        Raises
        ------
        ConfigurationError
            No node declares a parameter that was given.
        """
        declared = list(self._checks)
        # rclpy has no public way to what was given and not declared.
        others = unknown(self._node._parameter_overrides, declared)
        for name in others:
            if name not in of_all_nodes():
                raise ConfigurationError(undeclared(name, declared))
            self._node.get_logger().warning(f'{undeclared(name, declared)} It is not used.')
        for line in self._read:
            self._node.get_logger().info(line)

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


def _descriptor(declaration: Declaration) -> ParameterDescriptor:
    """What ROS tells of a parameter."""
    descriptor = ParameterDescriptor(
        description=declaration.description, read_only=not declaration.changeable
    )
    if declaration.choices:
        descriptor.additional_constraints = f'One of {", ".join(declaration.choices)}.'
    if declaration.above is not None:
        descriptor.additional_constraints = f'Above {declaration.above:g}.'
    lowest = declaration.above if declaration.minimum is None else declaration.minimum
    if lowest is None or declaration.maximum is None:
        return descriptor
    if isinstance(declaration.default, float):
        descriptor.floating_point_range = [
            FloatingPointRange(from_value=float(lowest), to_value=float(declaration.maximum))
        ]
    elif isinstance(declaration.default, int):
        descriptor.integer_range = [
            IntegerRange(from_value=int(lowest), to_value=int(declaration.maximum))
        ]
    return descriptor
