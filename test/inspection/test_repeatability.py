from dataclasses import replace

import numpy as np
import pytest
from dent_samples import make_dent

from ftp_dent_ros.dents.dent import Estimate
from ftp_dent_ros.dents.dent_list import DentList
from ftp_dent_ros.inspection.repeatability import study


def test_the_study_gives_back_the_deviations_that_were_put_in():
    rng = np.random.default_rng(5)
    within, between = 5e-6, 12e-6
    dents = DentList()
    places = [(0.2 * i + rng.uniform(0, 0.1), 0, 0.6) for i in range(20)]
    for frame in range(1, 41):
        seen, repeats = [], []
        for place in places:
            here = 2e-3 + between * rng.standard_normal()
            again = here + within * rng.standard_normal(2)
            dent = make_dent(place)
            seen.append(replace(dent, depth=Estimate(float(again.mean()), 1e-5)))
            repeats.append(tuple(replace(dent, depth=Estimate(float(d), 1e-5)) for d in again))
        dents.add(frame, seen, repeats=repeats)
    depth, length, _ = study(dents.entries)
    assert (depth.quantity, depth.dents, depth.frames) == ('depth', 20, 800)
    assert depth.within == pytest.approx(within, rel=0.1)
    assert depth.between == pytest.approx(between, rel=0.1)
    assert depth.total == pytest.approx(np.hypot(within, between), rel=0.1)
    assert (length.within, length.between) == (0, 0)
