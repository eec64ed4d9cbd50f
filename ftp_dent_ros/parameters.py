"""What a node's parameters may be, read and checked the same way of a file and on the node.

A node declares its parameters in a function of `Declarations`, with the values of a configuration,
so that a wrong one is found before anything is started, or with those that the node was given:
`ftp_dent_ros.ros.parameters.Parameters`.
"""

from __future__ import annotations

import contextlib
import difflib
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from ftp_dent_ros import files
from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.fields import Limits, conforming

# Declared by rclpy itself, or with a topic.
_OF_ROS = ('use_sim_time', 'start_type_description_service')
_OF_TOPICS = 'qos_overrides.'


@dataclass(frozen=True)
class Declaration:
    """What one parameter may be.

    Attributes
    ----------
    name, default, description
        The type is that of `default`: bool, int, float, str, or a list of floats, whose length is
        then fixed.
    limits : Limits
        What a number, each number of a list, or a text may be.
    changeable : bool
        Whether it can be set while the node runs.
    """

    name: str
    default: Any
    description: str
    limits: Limits
    changeable: bool

    def checked(self, value: Any) -> Any:
        """Value in the type of `default`; raises `ConfigurationError` if it cannot be."""
        is_list = isinstance(self.default, list)
        kind = tuple[(float,) * len(self.default)] if is_list else type(self.default)  # type: ignore[misc]
        try:
            made = conforming(Annotated[kind, self.limits], value)
        except ValueError as expected:
            raise ConfigurationError(
                f'parameter {self.name} is {value!r:.80}: give {expected}'
            ) from None
        return list(made) if is_list else made


class Declarations:
    """The parameters of one node, with the values that were given for them.

    Parameters
    ----------
    values : mapping
        By name; nested mappings are names with dots.
    folder : Path
        Where relative paths start.
    where : str
        What errors begin with.
    """

    def __init__(self, values: Mapping[str, Any], folder: Path = Path(), where: str = '') -> None:
        self._values = dict(flat(values))
        self._folder, self._where = folder, f'{where}: ' if where else ''
        #: By name.
        self.made: dict[str, Declaration] = {}
        #: Parameters that hold relative paths, as paths that do not depend on a folder.
        self.absolute: dict[str, str] = {}
        #: Parameters that name a file to be read, but secret ones.
        self.files: dict[str, Path] = {}

    def declare(
        self,
        name: str,
        default: Any,
        description: str,
        *,
        minimum: float = -math.inf,
        maximum: float = math.inf,
        above: float = -math.inf,
        choices: Sequence[str] = (),
        changeable: bool = False,
    ) -> Any:
        """Declare a parameter, as a `Declaration`, and return its value.

        Raises
        ------
        ConfigurationError
            The value that was given is of another type, out of its range, or none of the choices.
        """
        limits = Limits(minimum, maximum, above, tuple(choices))
        self.made[name] = Declaration(name, default, description, limits, changeable)
        value = self._values.get(name, default)
        if isinstance(default, float) and isinstance(value, str):
            # YAML 1.1 takes 1e-3 for a text; ROS takes it for a number.
            with contextlib.suppress(ValueError):
                value = float(value)
        try:
            return self.made[name].checked(value)
        except ConfigurationError as error:
            raise ConfigurationError(f'{self._where}{error}') from None

    def path(self, name: str, default: str, description: str) -> str:
        """Declare where something lies, whether it is there or not; relative as `file` is."""
        value = self.declare(name, default, description)
        if not value or value.startswith(files.SHIPPED):
            return value
        path = str(self._folder / Path(value).expanduser())
        if path != value and name in self._values:
            self.absolute[name] = path
        return path

    def file(
        self, name: str, default: str, description: str, *, secret: bool = False
    ) -> Path | None:
        """Declare a file to be read, and return its path; None if none is named.

        A relative path is one from the configuration's folder where ``ftp-dent up`` or the
        launch file read it there, else from where the node runs; ``shipped:NAME`` is one of the
        package's. The log names the file, with the id of its content, unless it is `secret`.

        Raises
        ------
        ConfigurationError
            There is no such file.
        """
        value = self.path(name, default, description)
        try:
            path = files.find(value).resolve() if value else None
        except ConfigurationError as error:
            raise ConfigurationError(f'{self._where}parameter {name}: {error}') from None
        if path is not None and not secret:
            self.files[name] = path
        return path

    def refuse_others(self, shared: Sequence[str] = (), elsewhere: Sequence[str] = ()) -> None:
        """Refuse what was given and not declared; `shared` ones may be declared `elsewhere`."""
        for name in self._values:
            known = (*self.made, *elsewhere) if name in shared else tuple(self.made)
            if unknown([name], known):
                raise ConfigurationError(f'{self._where}{undeclared(name, known)}')


def unknown(given: Iterable[str], declared: Iterable[str]) -> list[str]:
    """Names of parameters that neither a node nor ROS declares."""
    known = {*declared, *_OF_ROS}
    return [name for name in given if name not in known and not name.startswith(_OF_TOPICS)]


def undeclared(name: str, declared: Sequence[str]) -> str:
    """A sentence on a parameter that is not there, with the nearest that is."""
    near = difflib.get_close_matches(name, declared, 1)
    advice = f'did you mean {near[0]}?' if near else f'there are {", ".join(sorted(declared))}'
    return f'there is no parameter {name}: {advice}'


def flat(values: Mapping[str, Any], prefix: str = '') -> Iterable[tuple[str, Any]]:
    """Names and values of nested mappings, the names joined by dots, as ROS has them."""
    for name, value in values.items():
        if isinstance(value, Mapping):
            yield from flat(value, f'{prefix}{name}.')
        else:
            yield f'{prefix}{name}', value
