"""Which processes a payload's configuration asks for.

The file is a parameter file as ROS 2 has them, so that it serves ``ros2 run`` and ``ros2 launch``
too: each key is a node's name, after its namespace if it has one, and the name is that of an
executable of this package::

    camera_capture:
      ros__parameters:
        source: device
    /left/reconstruction:
      ros__parameters:
        method: least-squares

Parameters under ``/**`` go to every node.
"""

from __future__ import annotations

import json
import re
import shutil
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from ftp_dent_ros import files
from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.supervision.executables import EXECUTABLES, NODES
from ftp_dent_ros.supervision.processes import Program
from ftp_dent_ros.yaml_file import read_yaml

_BLOCK = (dict, type(None))
_NAME = re.compile(r'(/?[A-Za-z_]\w*)(/[A-Za-z_]\w*)*')


@dataclass(frozen=True)
class NodeEntry:
    """One process of a configuration.

    Attributes
    ----------
    executable : str
        One of `EXECUTABLES`; also the node's name.
    namespace : str
        ``/`` or an absolute namespace.
    parameters : mapping
        What stands under ``ros__parameters``.
    file : Path
        The configuration.
    shared : mapping
        What stands under ``/**``.
    absolute : mapping
        Parameters that hold a path relative to the configuration, as one that is not.
    files : mapping
        Parameters that name a file to be read, with its path; no secret ones.
    """

    executable: str
    namespace: str
    parameters: Mapping[str, Any]
    file: Path
    shared: Mapping[str, Any] = field(default_factory=dict)
    absolute: Mapping[str, str] = field(default_factory=dict)
    files: Mapping[str, Path] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """Name with namespace, without the leading slash."""
        return f'{self.namespace}/{self.executable}'.strip('/')

    @property
    def options(self) -> tuple[str, ...]:
        """The parameters as a command line's options: ``start_ns: 5`` is ``--start-ns 5``."""
        given = {**self.parameters, **self.absolute}
        return tuple(f'--{key.replace("_", "-")}={value}' for key, value in given.items())

    @property
    def program(self) -> Program:
        """The process to start."""
        if self.executable not in NODES:
            words: tuple[str, ...] = ('ftp_dent_ros.simulation.autopilot', *self.options)
        else:
            words = (
                *('ftp_dent_ros.nodes', self.executable, '--ros-args'),
                *('-r', f'__node:={self.executable}'),
                *('-r', f'__ns:={self.namespace}'),
                *self.parameter_words,
            )
        return Program(self.name, (sys.executable, '-m', *words))

    @property
    def parameter_words(self) -> tuple[str, ...]:
        """The parameters as a node's command line has them, behind ``--ros-args``."""
        # A quoted text in JSON is one in YAML too, which is how ROS reads a value.
        pairs = (('-p', f'{name}:={json.dumps(path)}') for name, path in self.absolute.items())
        return ('--params-file', str(self.file), *(word for pair in pairs for word in pair))


def frozen(entries: Sequence[NodeEntry], folder: Path) -> tuple[NodeEntry, ...]:
    """Entries whose configuration and files are copies in a folder.

    The rig and the pattern of a flight are those of its start, whatever is written into their
    files meanwhile and however often a node is restarted.
    """
    made = []
    for entry in entries:
        own = folder / entry.name.replace('/', '.')
        copies = {}
        for name, path in {'configuration': entry.file, **entry.files}.items():
            copies[name] = own / name / path.name
            copies[name].parent.mkdir(parents=True)
            shutil.copyfile(path, copies[name])
        file = copies.pop('configuration')
        absolute = {**entry.absolute, **{name: str(path) for name, path in copies.items()}}
        made.append(replace(entry, file=file, absolute=absolute))
    return tuple(made)


def read_configuration(path: str | Path) -> tuple[NodeEntry, ...]:
    """Processes of a configuration: a path, or ``shipped:`` and the name of a shipped one.

    Raises
    ------
    ConfigurationError
        The file is missing, is no parameter file, or names a node that this package does not have.
    """
    file = files.find(path).resolve()
    entries = []
    blocks = read_yaml(file, ConfigurationError)
    for key, block in blocks.items():
        if not isinstance(block, dict) or not isinstance(block.get('ros__parameters', 0), _BLOCK):
            raise ConfigurationError(
                f'{file}: {key}: needs a block ros__parameters with its parameters: add it'
            )
        if key == '/**':
            continue
        if not isinstance(key, str) or not _NAME.fullmatch(key):
            raise ConfigurationError(f'{file}: {key!r} is no name of a node: correct it')
        namespace, _, executable = key.strip('/').rpartition('/')
        if executable not in EXECUTABLES:
            raise ConfigurationError(
                f'{file}: {key}: this package has no node {executable!r}: '
                f'use one of {", ".join(EXECUTABLES)}'
            )
        parameters = block.get('ros__parameters') or {}
        shared = (blocks.get('/**') or {}).get('ros__parameters') or {}
        entries.append(NodeEntry(executable, f'/{namespace}', parameters, file, shared))
    if not entries:
        raise ConfigurationError(f'{file}: names no node: use some of {", ".join(EXECUTABLES)}')
    twice = {entry.name for entry in entries if [e.name for e in entries].count(entry.name) > 1}
    if twice:
        raise ConfigurationError(f'{file}: {sorted(twice)[0]} is there twice: remove one')
    return tuple(entries)
