"""A pattern as a file: ``pattern.yaml``."""

from __future__ import annotations

import os
from dataclasses import asdict

import yaml

from ftp_dent_ros.errors import PatternError
from ftp_dent_ros.fields import Fields
from ftp_dent_ros.files import write_atomically
from ftp_dent_ros.pattern.pattern import OF_CODE, Pattern
from ftp_dent_ros.yaml_file import read_yaml


def read_pattern(path: str | os.PathLike[str]) -> Pattern:
    """Read ``pattern.yaml``; raises `PatternError` with the field that is wrong."""
    # Whoever draws a pattern without a word about it takes white for 255.
    data = {'levels': 255, **read_yaml(path, PatternError)}
    return Fields(data, f'{path}: ', PatternError).record(Pattern)


def write_pattern(path: str | os.PathLike[str], pattern: Pattern) -> None:
    """Write ``pattern.yaml``; a file under that name is whole or not there."""
    with write_atomically(path) as temporary:
        left_out = OF_CODE if pattern.code != 'contrast' else ()
        fields = {name: value for name, value in asdict(pattern).items() if name not in left_out}
        temporary.write_text(yaml.safe_dump(fields, sort_keys=False), encoding='utf-8')
