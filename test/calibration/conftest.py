"""The shipped rig and pattern, for the checks of a calibration."""

from __future__ import annotations

import pytest

from ftp_dent_ros.files import config_folder
from ftp_dent_ros.pattern.file import read_pattern
from ftp_dent_ros.rig.rig import read_rig


@pytest.fixture(scope='package')
def rig():
    return read_rig(config_folder() / 'rig.yaml')


@pytest.fixture(scope='package')
def pattern():
    return read_pattern(config_folder() / 'pattern.yaml')
