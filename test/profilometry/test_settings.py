import pytest

from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.profilometry import METHODS, UNWRAPPINGS, Settings


def test_every_choice_is_taken():
    for method, options in METHODS.items():
        for unwrapping in UNWRAPPINGS:
            settings = Settings.chosen(method, 16, unwrapping=unwrapping, tau=1)
            assert (settings.method, settings.stride) == (method, 16)
            assert settings.unwrapping == (unwrapping if 'unwrapping' in options else None)


@pytest.mark.parametrize(
    'values',
    [
        {'unwrapping': 'itoh'},
        {'tau': 0.5},
        {'method': 'direct', 'tau': 0.5},
        {'method': 'direct', 'unwrapping': 'itoh', 'tau': 0.5},
    ],
)
def test_an_option_that_the_method_does_not_use_is_refused(values):
    with pytest.raises(ConfigurationError, match='option of'):
        Settings(**values)


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
