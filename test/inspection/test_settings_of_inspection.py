import pytest

from ftp_dent_ros.dents.dent import SmallestDent
from ftp_dent_ros.errors import ConfigurationError


@pytest.mark.parametrize('value', [0, -1e-4, 1e-12, 5.0, float('nan'), float('inf'), True, '0.1'])
@pytest.mark.parametrize('name', ['smallest_depth', 'smallest_width'])
def test_what_is_no_length_is_refused(name, value):
    with pytest.raises(ConfigurationError, match=name):
        SmallestDent(**{name: value})
