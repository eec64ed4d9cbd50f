from types import SimpleNamespace

import pytest

from ftp_dent_ros.dents.dent import Estimate, SmallestDent
from ftp_dent_ros.inspection.measuring.kinds import kind_of


@pytest.mark.parametrize(
    ('sign', 'is_cut', 'kind'),
    [(-1, True, ''), (-1, False, 'bump'), (1, True, 'other'), (1, False, 'dent')],
)
def test_what_is_outward_and_narrow_where_the_rim_cuts_it_is_nothing(sign, is_cut, kind):
    # It may be wider than the smallest dent.
    seen = SimpleNamespace(
        depth=Estimate(3e-4, 2e-5),
        length=Estimate(0.03, 3e-3),
        width=Estimate(0.008, 3e-3),
        outline=SimpleNamespace(length=(0.03, 0.0)),
        radius=0.02,
        slender=1.0,
        is_cut=is_cut,
        hidden=0.0,
        shown=3e-4,
    )
    assert kind_of(seen, sign, 4e-3, SmallestDent(), '')[0] == kind
