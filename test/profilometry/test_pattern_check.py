from __future__ import annotations

import re
from dataclasses import dataclass, replace

import numpy as np
import pytest
from small_scenes import PATTERN, RIG, Scene, panel

from ftp_dent_ros.errors import OtherPatternError
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.profilometry import Reconstructor, Settings
from ftp_dent_ros.profilometry.lit_area import RimLine
from ftp_dent_ros.profilometry.pattern_check import _inside


@pytest.fixture(scope='module')
def framed():
    """A flat skin on which the rims of the projector's frame are in view."""
    wide = replace(RIG, camera=replace(RIG.camera, camera_matrix=_shorter(RIG.camera)))
    return Scene.of(panel(half=0.6), rig=wide)


def _shorter(lens):
    return lens.camera_matrix * np.array([[0.6, 1, 1], [1, 0.6, 1], [1, 1, 1]])


def refusal(scene, image=None, method='least-squares', **changes):
    told = replace(PATTERN, **changes)
    reconstructor = Reconstructor(scene.rig, told, Settings(method, stride=2))
    with pytest.raises(OtherPatternError) as error:
        reconstructor.reconstruct(scene.image if image is None else image)
    return str(error.value)


@pytest.mark.parametrize('period', [6.4, 7.6, 8.4, 10.0])
@pytest.mark.parametrize('method', ['least-squares', 'virtual-reference'])
def test_a_wrong_period_is_refused_with_the_one_seen(framed, method, period):
    sentence = refusal(framed, method=method, period_px=period)
    assert f'a period of {period:g} px with the stripe at 320' in sentence
    seen = re.search(r'(?:with|is) a period of (\d+\.\d+) px(?: \(as seen\)|, if)', sentence)
    assert float(seen[1]) == pytest.approx(8.0, rel=0.01)


def test_a_stripe_that_is_elsewhere_is_refused_with_its_column(framed):
    sentence = refusal(framed, stripe_center_px=340.0)
    seen = re.search(r'seen is a period of (\d+\.\d+) px with the stripe at (\d+)', sentence)
    assert float(seen[1]) == pytest.approx(8.0, rel=0.01)
    assert float(seen[2]) == pytest.approx(320, abs=2)


def test_of_coded_fringes_no_stripe_is_spoken_of(framed):
    coded = replace(PATTERN, code='contrast')
    image = Scene.of(*framed.surface.panels, projected=coded.draw(), rig=framed.rig).image
    with pytest.raises(OtherPatternError) as error:
        Reconstructor(framed.rig, coded, Settings(stride=2)).measure(image[::-1].copy())
    assert 'a period of 8 px with a crest at 320' in str(error.value)
    assert 'stripe' not in str(error.value)


@pytest.fixture(scope='module')
def coded(framed):
    pattern = replace(PATTERN, code='contrast')
    return Scene.of(*framed.surface.panels, projected=pattern.draw(), rig=framed.rig)


@pytest.mark.parametrize(
    'changes',
    [
        *({'period_px': period} for period in (7.0, 7.5, 7.8, 8.2, 8.4, 9.0, 10.0)),
        # Light of a projector that stands elsewhere, but for the code.
        *({'stripe_center_px': zero} for zero in (316.0, 317.5, 323.0, 324.0)),
    ],
)
def test_of_coded_fringes_another_pattern_has_another_code(coded, changes):
    told = replace(PATTERN, code='contrast', **changes)
    with pytest.raises(OtherPatternError, match='code of the fringes is of another pattern'):
        Reconstructor(coded.rig, told, Settings(stride=2)).measure(coded.image)


def test_of_coded_fringes_the_last_rim_confirms_the_pattern(coded):
    told = replace(PATTERN, code='contrast')

    def confirmed(pattern):
        measured = Reconstructor(coded.rig, pattern, Settings(stride=2)).measure(coded.image)
        return measured.coverage.confirmed

    assert confirmed(told)
    # By chance, of the sixteen codes these have the same.
    other = replace(told, period_px=7.44)
    assert (other.sequence == told.sequence).all()
    with pytest.raises(OtherPatternError, match=r'end, and their rows lie, .* period of 7\.99 px'):
        confirmed(other)


def test_a_photograph_that_is_mirrored_or_turned_is_refused(framed):
    image = framed.image
    for other in (image[::-1, ::-1], image[:, ::-1], image[::-1]):
        assert 'do not mirror or turn' in refusal(framed, np.ascontiguousarray(other))


def test_a_period_that_makes_a_surface_too_steep_is_refused_without_any_rim(scene):
    sentence = refusal(scene('flat'), period_px=4.0)
    assert re.search(r'tilted by 6\d degrees; fringes of \d+\.\d px would face', sentence)


@pytest.mark.parametrize('period', [5.0, 12.0, 20.0])
def test_fringes_of_a_period_far_from_the_told_one_are_not_called_dark(scene, period):
    said = refusal(scene('flat'), period_px=period)
    assert f'with a period of {period:g} px' in said and 'would face camera and projector' in said


def test_of_coded_fringes_a_turned_photograph_has_another_code(coded):
    turned = np.ascontiguousarray(coded.image[::-1, ::-1])
    with pytest.raises(OtherPatternError, match='do not mirror or turn the photograph'):
        told = replace(PATTERN, code='contrast')
        Reconstructor(coded.rig, told, Settings(stride=2)).measure(turned)


def test_whether_the_pattern_can_be_checked_is_said(framed, scene):
    def measured(one, method):
        return Reconstructor(one.rig, PATTERN, Settings(method, stride=2)).measure(one.image)

    for method in ('least-squares', 'virtual-reference'):
        assert measured(framed, method).coverage.confirmed
        coverage = measured(scene('flat'), method).coverage
        assert not coverage.confirmed and 'could not be checked' in coverage.remarks[-1]


def test_panels_that_end_along_the_fringes_are_not_refused():
    for half, centre in ((0.06, 0.0), (0.075, 0.0), (0.09, 0.01)):
        scene = Scene.of(panel(tilt=(0.0, 0.0), half=half, centre=(centre, 0.0)))
        cloud = Reconstructor(scene.rig, PATTERN, Settings(stride=2)).reconstruct(scene.image)
        assert np.median(scene.errors_mm(cloud)) < 0.1


@dataclass(frozen=True)
class SeenRims:
    """What `_inside` asks of a lit area: rims as they were seen, and the surface's tilts."""

    told: RimLine
    straightened: RimLine
    pattern: Pattern = PATTERN

    def tilt(self, period):
        return 8.0 if period == self.pattern.period_px else 4.0

    def upper_and_lower(self, period):
        return {'upper': self.told if period == self.pattern.period_px else self.straightened}


@pytest.mark.parametrize(
    ('level', 'rise', 'told'),
    # A period 5 % off in a sharp picture, and the right one where blur hides 11 px of the rim.
    [(5.9, 3.4, True), (11.5, 3.7, False)],
)
def test_what_blur_hides_of_a_rim_may_be_uneven(level, rise, told):
    area = SeenRims(RimLine(level, rise, level - rise / 2), RimLine(level, 1.0, level))
    assert (_inside(area, {True: 2.1}) is not None) == told
