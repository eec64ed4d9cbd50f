"""What a photometry may be."""

import math

import pytest

from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.simulation import Photometry

WRONG = {
    'exposure': (0, -1, math.nan),
    'reference_distance': (0, -0.8),
    'ambient': (-0.1, math.inf),
    'projector_black': (1.1, -0.1),
    'projector_gamma': (0,),
    'full_well': (0, -5),
    'camera_gamma': (0,),
    'encoding': ('yuv422', 'mono'),
    'jpeg_quality': (101, -1),
    'samples': (0, 3, 512),
}


@pytest.mark.parametrize(
    ('name', 'value'), [(n, v) for n, values in WRONG.items() for v in values]
)
def test_a_value_out_of_its_range_is_refused_by_name(name, value):
    with pytest.raises(ConfigurationError) as refusal:
        Photometry(**{name: value})
    message = str(refusal.value)
    assert message.startswith(f'{name} is {value!r}: give ')
    assert '\n' not in message
