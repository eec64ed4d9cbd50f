"""YAML files of plain data: settings, patterns, calibrations, the metadata of bags."""

from __future__ import annotations

import os
from collections import Counter
from pathlib import Path
from typing import Any

import yaml

from ftp_dent_ros.errors import InputError


def read_yaml(path: str | os.PathLike[str], error: type[InputError]) -> dict[str, Any]:
    """Mapping in a YAML file; `error` is raised, with the line, if it is no plain data.

    All keys are texts and whole numbers have 64 bits, as ROS has them.
    """
    try:
        with Path(path).open('rb') as file:
            text = file.read().decode('utf-8')
    except OSError as reason:
        raise error(f'{path}: cannot be read ({reason.strerror}): check the path') from None
    except UnicodeDecodeError:
        raise error(f'{path}: cannot be read (not text in UTF-8): check the path') from None
    try:
        data = yaml.load(text, _PlainLoader)
    except RecursionError:
        raise error(f'{path}: not valid YAML (nested too deeply): correct the file') from None
    except yaml.YAMLError as reason:
        where = getattr(reason, 'problem_mark', None)
        line = f' in line {where.line + 1}' if where else ''
        what = getattr(reason, 'problem', None)
        said = f' ({what})' if what else ''
        raise error(f'{path}: not valid YAML{line}{said}: correct the file') from None
    if not isinstance(data, dict):
        raise error(f'{path}: holds no mapping of fields: correct the file')
    return data


class _PlainLoader(yaml.SafeLoader):
    """Refuses what a file of settings cannot mean, and says in which line."""

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        try:
            value = super().construct_object(node, deep)
        except (yaml.YAMLError, RecursionError):
            raise
        except Exception as reason:  # what a date, a number or a tag out of place makes of it
            kind = node.tag.rpartition(':')[2]
            what = (
                f'{node.value!r:.40} is no {kind}' if isinstance(node.value, str) else str(reason)
            )
            raise self._refusal(node, what) from None
        if isinstance(value, int) and not -(1 << 63) <= value < 1 << 64:
            raise self._refusal(node, 'a number of more than 64 bits')
        return value

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        names = Counter(key.value for key, _ in node.value if isinstance(key, yaml.ScalarNode))
        for name, times in names.most_common(1):
            if times > 1:
                raise self._refusal(node, f'{name!r:.40} is there {times} times')
        mapping = super().construct_mapping(node, deep)
        for key in mapping:
            if not isinstance(key, str):
                raise self._refusal(node, f'the key {key!r} is no text: put it in quotes')
        return mapping

    def _refusal(self, node: yaml.Node, problem: str) -> yaml.YAMLError:
        return yaml.constructor.ConstructorError(None, None, problem, node.start_mark)
