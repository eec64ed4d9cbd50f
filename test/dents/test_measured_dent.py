import math

import pytest

from ftp_dent_ros.dents.dent import Estimate, SmallestDent
from ftp_dent_ros.errors import ConfigurationError


def test_a_value_that_nothing_bounds_is_not_measured():
    for uncertainty in (math.nan, math.inf, -1e-6):
        estimate = Estimate(3.342e-3, uncertainty)
        assert not estimate.is_measured and math.isnan(estimate.value)
    # A bound may be zero, and the next dent nowhere.
    assert Estimate(-1e-3, 0.0).is_measured and Estimate(math.inf, 1e-3).is_measured


@pytest.mark.parametrize('value', [0, 5.0, math.nan, '0.1'])
@pytest.mark.parametrize('name', ['smallest_depth', 'smallest_width'])
def test_what_is_no_length_is_refused(name, value):
    with pytest.raises(ConfigurationError, match=name):
        SmallestDent(**{name: value})
