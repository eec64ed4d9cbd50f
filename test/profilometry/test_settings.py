import pytest

from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.profilometry import METHODS, UNWRAPPINGS, Settings


def test_every_choice_is_taken():
    for method in METHODS:
        for unwrapping in UNWRAPPINGS:
            settings = Settings(method, unwrapping, tau=1, stride=16)
            assert (settings.method, settings.unwrapping) == (method, unwrapping)


@pytest.mark.parametrize(
    ('name', 'value'),
    [
        ('method', 'fourier'),
        ('method', None),
        ('unwrapping', ''),
        ('tau', 0),
        ('tau', 1.01),
        ('tau', float('nan')),
        ('tau', True),
        ('tau', '0.8'),
        ('stride', 0),
        ('stride', 17),
        ('stride', 2.0),
        ('stride', True),
    ],
)
def test_what_is_no_choice_is_named(name, value):
    with pytest.raises(ConfigurationError, match=f'{name} is {value!r}: '):
        Settings(**{name: value})
