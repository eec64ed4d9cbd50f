"""Every field of every file of settings, with what nobody would write there."""

from __future__ import annotations

import copy
from pathlib import Path

import pytest
import yaml

from ftp_dent_ros.dents.rules import read_rules
from ftp_dent_ros.errors import FtpDentError
from ftp_dent_ros.files import config_folder
from ftp_dent_ros.pattern.file import read_pattern
from ftp_dent_ros.rig.rig import read_rig
from ftp_dent_ros.simulation.world import read_world
from ftp_dent_ros.supervision.configuration import read_configuration

HOSTILE = """
- null
- []
- {}
- [[[1]]]
- {x: {y: 1}}
- 2024-01-31
- !!binary aGVsbG8=
- !!set {x}
- "\\e[2J"
- true
- -1
- 0
- .nan
- .inf
- -1.0e+300
- 9223372036854775807
- 1.0e-320
"""


def places(data, where=()):
    """Path to each value of nested mappings and lists."""
    items = data.items() if isinstance(data, dict) else enumerate(data)
    for key, value in items:
        yield (*where, key)
        if isinstance(value, dict | list):
            yield from places(value, (*where, key))


def once(data):
    """The same with one entry of each kind in a list: what has the same fields is read alike."""
    if isinstance(data, dict):
        return {key: once(value) for key, value in data.items()}
    if isinstance(data, list) and all(isinstance(each, dict) for each in data):
        return list({tuple(each): once(each) for each in reversed(data)}.values())[::-1]
    return data


def read_programs(path):
    for entry in read_configuration(path):
        assert entry.program.command


@pytest.mark.parametrize(
    ('name', 'read', 'step'),
    [
        ('rig.yaml', read_rig, 7),
        ('pattern.yaml', read_pattern, 1),
        ('example_rules.yaml', read_rules, 3),
        ('scene.yaml', read_world, 11),
        ('simulation.yaml', read_programs, 7),
    ],
)
@pytest.mark.filterwarnings('error::RuntimeWarning')
def test_hostile_values_are_refused_or_read_and_never_break_anything(tmp_path, name, read, step):
    data = once(yaml.safe_load((config_folder() / name).read_text()))
    hostile = yaml.safe_load(HOSTILE)
    path = Path(tmp_path, name)
    refused = 0
    cases = [(place, value) for place in places(data) for value in hostile]
    # A step that is prime to the number of values comes past all of them.
    cases = [case for n, case in enumerate(cases) if n % step == 0 or case[0][-1] == 'count']
    for place, value in cases:
        spoilt = copy.deepcopy(data)
        within = spoilt
        for key in place[:-1]:
            within = within[key]
        within[place[-1]] = value
        path.write_text(yaml.safe_dump(spoilt))
        try:
            read(path)
        except FtpDentError as error:
            refused += 1
            assert str(error).startswith(str(path)), f'{place}: {value!r}: {error}'
            assert '\x1b' not in str(error) and len(str(error)) < 2200
        except Exception as error:
            raise AssertionError(f'{place}: {value!r}') from error
    assert refused > len(cases) // 4
