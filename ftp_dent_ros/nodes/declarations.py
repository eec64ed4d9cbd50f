"""Whether a configuration fits the nodes' parameters; without rclpy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from ftp_dent_ros import files
from ftp_dent_ros.nodes.settings import OF_NODES, read
from ftp_dent_ros.parameters import Declarations, flat
from ftp_dent_ros.supervision.configuration import NodeEntry
from ftp_dent_ros.supervision.executables import SIMULATED_AUTOPILOT


def names_of_all() -> tuple[str, ...]:
    """Names of the parameters of all nodes."""
    given = Declarations({})
    for settings in OF_NODES.values():
        read(settings, given)
    return tuple(given.made)


def fitted(entries: Sequence[NodeEntry]) -> tuple[NodeEntry, ...]:
    """Entries whose parameters the nodes will take, with their relative paths made absolute.

    Relative to the folder of the configuration, that is.

    Raises
    ------
    ConfigurationError
        A parameter is wrong, or none of the node's; or a file that one names is not there.
    """
    return tuple(map(_fitted, entries))


def settings_of(entry: NodeEntry) -> Any:
    """A node's settings as it will have them: one of `OF_NODES`; raises as `fitted`."""
    return read(OF_NODES[entry.executable], _given(entry))


def _given(entry: NodeEntry) -> Declarations:
    values = {**dict(flat(entry.shared)), **dict(flat(entry.parameters))}
    return Declarations(values, entry.file.parent, f'{entry.file}: {entry.name}')


def _fitted(entry: NodeEntry) -> NodeEntry:
    own = dict(flat(entry.parameters))
    if entry.executable == SIMULATED_AUTOPILOT:
        from ftp_dent_ros.simulation.autopilot import build_parser

        given = _given(replace(entry, shared={}))
        given.file('scene', f'{files.SHIPPED}scene.yaml', 'Scene file.')
        given.refuse_others(list(own), list(vars(build_parser().parse_args([]))))
    else:
        given = _given(entry)
        read(OF_NODES[entry.executable], given)
        given.refuse_others(
            [name for name, _ in flat(entry.shared) if name not in own], names_of_all()
        )
    return replace(entry, absolute=given.absolute, files=given.files)
