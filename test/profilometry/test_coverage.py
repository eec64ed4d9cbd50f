import numpy as np
import pytest

from ftp_dent_ros.cloud.coverage import CLIPPED, UNEXPLAINED, UNTIED, Coverage


@pytest.fixture
def masks():
    lit = np.zeros((10, 20), bool)
    lit[:, :10] = True
    measured, clipped, untied = (np.zeros_like(lit) for _ in range(3))
    measured[:, 5:] = True  # what lies beyond the lit area does not count
    clipped[:3, :5] = True
    untied[:5, :5] = True
    return lit, measured, clipped, untied


def test_the_first_reason_counts(masks):
    lit, measured, clipped, untied = masks
    coverage = Coverage.of(lit, measured, clipped=clipped, untied=untied)
    assert coverage.missing == pytest.approx({CLIPPED: 0.15, UNTIED: 0.1, UNEXPLAINED: 0.25})
    assert coverage.share == pytest.approx(0.5)
    assert [remark.split()[0] for remark in coverage.remarks] == ['25%', '15%', '10%']


def test_what_holds_nowhere_is_no_reason(masks):
    lit, _, clipped, _ = masks
    coverage = Coverage.of(lit, lit, clipped=clipped)
    assert coverage.missing == {}
    assert coverage.share == 1
    assert coverage.remarks == ()


def test_little_is_not_remarked_but_what_is_not_confirmed_is():
    coverage = Coverage({CLIPPED: 0.019}, confirmed=False)
    assert len(coverage.remarks) == 1
    assert 'could not be checked' in coverage.remarks[0]


def test_nothing_lit_is_no_division_by_zero():
    nothing = np.zeros((4, 4), bool)
    assert Coverage.of(nothing, nothing).share == 1


def test_what_diagnostics_show_tells_the_shares_again():
    coverage = Coverage({UNTIED: 0.5312, CLIPPED: 0.0304})
    again = Coverage.noted(coverage.notes)
    assert again is not None
    assert again.missing == {UNTIED: 0.531, CLIPPED: 0.03}
    assert again.remarks == coverage.remarks
    assert Coverage.noted({}) is None
    assert Coverage.noted({**coverage.notes, f'lit but {CLIPPED}': 'much'}) is None
