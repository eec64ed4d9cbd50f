"""A pattern as a file: ``pattern.yaml``."""

from __future__ import annotations

import os
from dataclasses import asdict
from typing import Any

import yaml

from ftp_dent_ros.errors import PatternError
from ftp_dent_ros.files import write_atomically
from ftp_dent_ros.pattern.pattern import OF_CODE, Pattern
from ftp_dent_ros.yaml_file import read_yaml

_REQUIRED = ('width', 'height', 'period_px', 'stripe_center_px')


def read_pattern(path: str | os.PathLike[str]) -> Pattern:
    """Read ``pattern.yaml``; raises `PatternError` with the field that is wrong."""
    return pattern_from_fields(read_yaml(path, PatternError), str(path))


def pattern_from_fields(data: dict[str, Any], where: str) -> Pattern:
    """Pattern of the fields of ``pattern.yaml``; errors name `where` they came from."""
    if data.keys().isdisjoint(_REQUIRED):
        needed = ', '.join(_REQUIRED)
        raise PatternError(f"{where}: holds none of a pattern's fields ({needed}): check the path")
    for name in _REQUIRED:
        if name not in data:
            raise PatternError(f'{where}: {name} is missing: add it')
    unknown = data.keys() - Pattern.__dataclass_fields__.keys()
    if unknown:
        raise PatternError(f'{where}: unknown field {sorted(unknown)[0]!r}: remove it')
    try:
        # Whoever draws a pattern without a word about it takes white for 255.
        return Pattern(**{'levels': 255, **data})
    except PatternError as reason:
        raise PatternError(f'{where}: {reason}') from None


def write_pattern(path: str | os.PathLike[str], pattern: Pattern) -> None:
    """Write ``pattern.yaml``; a file under that name is whole or not there."""
    with write_atomically(path) as temporary:
        left_out = OF_CODE if pattern.code != 'contrast' else ()
        fields = {name: value for name, value in asdict(pattern).items() if name not in left_out}
        temporary.write_text(yaml.safe_dump(fields, sort_keys=False), encoding='utf-8')
