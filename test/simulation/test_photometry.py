"""What a photometry may be."""

import math

import pytest

from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.simulation import Photometry

WRONG = {
    'exposure': (0, math.nan),
    'ambient': (-0.1, math.inf),
    'projector_black': (1.1,),
    'encoding': ('yuv422', 'mono'),
    'jpeg_quality': (101,),
    'samples': (3,),
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
