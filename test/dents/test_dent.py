import math

import numpy as np
import pytest

from ftp_dent_ros.dents.dent import Estimate


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
