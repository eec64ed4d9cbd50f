import math

import numpy as np
import pytest

from ftp_dent_ros.dents.dent import Estimate, SmallestDent
from ftp_dent_ros.errors import ConfigurationError


@pytest.mark.parametrize('uncertainty', [math.nan, math.inf, -1e-6])
def test_a_value_that_nothing_bounds_is_not_measured(uncertainty):
    estimate = Estimate(3.342e-3, uncertainty)
    assert not estimate.is_measured
    assert np.isnan([estimate.value, estimate.uncertainty]).all()


def test_a_value_has_its_uncertainty():
    estimate = Estimate(-1e-3, 0.0)
    assert estimate.is_measured
    assert (estimate.value, estimate.uncertainty) == (-1e-3, 0.0)
    # The next dent may be nowhere.
    assert Estimate(math.inf, 1e-3).is_measured


@pytest.mark.parametrize('value', [0, 5.0, math.nan, '0.1'])
@pytest.mark.parametrize('name', ['smallest_depth', 'smallest_width'])
def test_what_is_no_length_is_refused(name, value):
    with pytest.raises(ConfigurationError, match=name):
        SmallestDent(**{name: value})
