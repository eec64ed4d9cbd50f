"""What a photometry may be."""

import dataclasses
import math

import pytest

from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.simulation import Photometry

WRONG = {
    'exposure': (0, -1, 'bright', math.nan, True),
    'reference_distance': (0, -0.8),
    'ambient': (-0.1, math.inf),
    'shading': (1, 'yes', None),
    'defocus_px': (-0.1,),
    'projector_black': (1.1, -0.1),
    'projector_gamma': (0,),
    'speckle_contrast': (1.5, -0.1),
    'speckle_size_px': (-1,),
    'phase_noise_px': (-1, None),
    'psf_px': (-0.4,),
    'full_well': (0, -5),
    'read_noise': (-0.8, [0.8]),
    'crosstalk': (1.1, -0.1),
    'camera_gamma': (0,),
    'encoding': ('yuv422', 'mono', 8),
    'bayer': (0, 'RGGB'),
    'jpeg_quality': (101, 90.5, -1, True),
    'samples': (0, 3, 512, 2.0),
}


def test_every_field_is_tried():
    assert WRONG.keys() == {field.name for field in dataclasses.fields(Photometry)}


@pytest.mark.parametrize(
    ('name', 'value'), [(n, v) for n, values in WRONG.items() for v in values]
)
def test_a_value_out_of_its_range_is_refused_by_name(name, value):
    with pytest.raises(ConfigurationError) as refusal:
        Photometry(**{name: value})
    message = str(refusal.value)
    assert message.startswith(f'photometry: {name} is {value!r}: give ')
    assert '\n' not in message
