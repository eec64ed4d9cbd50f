"""Parameters of a node: described, checked, and wrong only with a sentence."""

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

from ftp_dent_ros import files
from ftp_dent_ros.errors import ConfigurationError, InputError
from ftp_dent_ros.parameters import Declaration, Declarations, undeclared, unknown


class Parameters(Declarations):
    """The parameters of one node.

    A whole number is taken for a floating point one (``rate:=9``), which rclpy alone refuses.
    """

    def __init__(self, node: Node) -> None:
        # rclpy has no public way to what was given.
        given = node._parameter_overrides
        super().__init__({name: each.value for name, each in given.items()})
        self._node = node
        self._listeners: list[Callable[[dict[str, Any]], None]] = []
        node.add_on_set_parameters_callback(self._set)

    def declare(self, name: str, default: Any, description: str, **limits: Any) -> Any:
        """As `Declarations.declare`, on the node too."""
        value = super().declare(name, default, description, **limits)
        descriptor = _descriptor(self.made[name])
        self._node.declare_parameter(name, value, descriptor, ignore_override=True)
        return value

    def close(self, of_all_nodes: Callable[[], Sequence[str]]) -> None:
        """End the declarations: refuse what was given and not declared, log the files.

        What another node of the package declares may be there for that one, by ``/**``: the log
        only says so.

        Parameters
        ----------
        of_all_nodes : callable
            Gives the names that the package's nodes declare.

        Raises
        ------
        ConfigurationError
            No node declares a parameter that was given.
        """
        declared = tuple(self.made)
        for name in unknown(self._values, declared):
            if name not in of_all_nodes():
                raise ConfigurationError(undeclared(name, declared))
            self._node.get_logger().warning(f'{name} is not used: {undeclared(name, declared)}')
        for name, path in self.files.items():
            line = f'{name}: {path} (SHA-256 {files.content_id(path)}...)'
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
        values = {item.name: item.value for item in parameters if item.name in self.made}
        try:
            for name, value in values.items():
                self.made[name].checked(value)
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
    limits = declaration.limits
    if limits.choices:
        descriptor.additional_constraints = f'One of {", ".join(limits.choices)}.'
    if math.isfinite(limits.above):
        descriptor.additional_constraints = f'Above {limits.above:g}.'
    lowest, highest = max(limits.low, limits.above), limits.high
    if not (math.isfinite(lowest) and math.isfinite(highest)):
        return descriptor
    if isinstance(declaration.default, float):
        descriptor.floating_point_range = [
            FloatingPointRange(from_value=float(lowest), to_value=float(highest))
        ]
    elif isinstance(declaration.default, int):
        descriptor.integer_range = [IntegerRange(from_value=int(lowest), to_value=int(highest))]
    return descriptor
