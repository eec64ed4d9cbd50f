"""Growth is told where there is one, with its interval, and not where there is none."""

from dataclasses import replace

import numpy as np
import pytest
from dent_samples import make_dent

from ftp_dent_ros.dents.dent import Estimate
from ftp_dent_ros.survey.growth import Growth, changes_of

SIGMA = 6e-6


def pairs(rng, count, grown=0, scale=1.0, off=0.6):
    result = []
    for index in range(count):
        depth = rng.uniform(3e-4, 2e-3)
        dents = []
        for more, factor in ((0.0, 1.0), (5e-5 * (index < grown), scale)):
            measured = factor * (depth + more) + off * SIGMA * rng.normal()
            dents.append(
                replace(make_dent(), depth=Estimate(measured, SIGMA), length=Estimate(0.04, 4e-4))
            )
        result.append(dents)
    return [a for a, _ in result], [b for _, b in result]


def test_three_of_sixty_have_grown_though_the_other_rig_sees_all_of_them_larger():
    rng = np.random.default_rng(5)
    for _ in range(20):
        changes, scales = changes_of(*pairs(rng, 60, grown=3, scale=1.004))
        verdicts = [[change.verdict for change in each] for each in changes]
        assert verdicts[:3] == [[1, 0, 0]] * 3
        assert not np.any(verdicts[3:])
        assert scales[0].factor == pytest.approx(1.004, abs=4 * scales[0].uncertainty)
        for each in changes[:3]:
            assert abs(each[0].estimate.value - 5e-5) < 1.6 * each[0].half


def test_the_intervals_hold_what_they_say():
    rng = np.random.default_rng(6)
    inside = []
    for count in (1, 4, 30):
        for _ in range(60 // count + 10):
            changes, _ = changes_of(*pairs(rng, count, off=0.7))
            inside += [abs(each[0].estimate.value) < each[0].half for each in changes]
    assert np.mean(inside) > 0.93


def test_a_cut_dent_is_not_compared_and_one_without_uncertainty_never_grows():
    rng = np.random.default_rng(7)
    earlier, later = pairs(rng, 3, grown=3, off=0.0)
    later[0] = replace(later[0], is_cut=True)
    later[1] = replace(later[1], depth=Estimate(later[1].depth.value, float('nan')))
    changes, _ = changes_of(earlier, later)
    assert changes[0] == ()
    assert changes[1][0].verdict == 0


def test_what_the_skins_tell_of_a_depth_counts_and_not_the_depths():
    rng = np.random.default_rng(8)
    earlier, later = pairs(rng, 12, off=1.0)
    grown = 2e-5
    deeper = [
        Growth(Estimate((grown if index < 2 else 0) + 1e-6 * rng.normal(), 1e-6), 30.0, 1e-9)
        for index in range(11)
    ]
    changes, (depth, *_) = changes_of(earlier, later, [*deeper, None])
    assert [each[0].verdict for each in changes] == [1, 1] + [0] * 10
    for each, direct in zip(changes, deeper, strict=False):
        assert each[0].estimate.value == pytest.approx(direct.estimate.value, abs=2e-6)
        assert each[0].half < 5e-6
    assert changes[-1][0].half > 5e-6 and depth.quantity == 'depth'
