import numpy as np
import pytest

from ftp_dent_ros.errors import SaturatedError, TooDarkError
from ftp_dent_ros.profilometry.carrier import Carrier
from ftp_dent_ros.profilometry.fourier_transform.region import Window, clipped, lit_region, trusted

CARRIER = Carrier(1 / 8)
PANEL = np.s_[30:150, 64:264]


def photograph(amplitude=80.0, level=90.0, background=5.0):
    """Fringes on a panel before a dark wall."""
    red = np.full((180, 320), background)
    red[PANEL] = level + amplitude * np.cos(2 * np.pi * np.arange(64, 264) / 8)
    return (red + np.random.default_rng(0).normal(0, 0.8, red.shape)).astype(np.float32)


def panel_only(region):
    on = np.zeros(region.shape, bool)
    on[PANEL] = True
    assert not region[~on].any()
    return region[PANEL].mean()


@pytest.mark.parametrize(('amplitude', 'level'), [(80, 90), (8, 60), (8, 12), (120, 130)])
def test_region_is_the_panel_less_its_rim(amplitude, level):
    assert panel_only(lit_region(photograph(amplitude, level), CARRIER)) > 0.94


def test_a_wall_in_daylight_is_no_part_of_the_region():
    assert panel_only(lit_region(photograph(80, 130, background=60), CARRIER)) > 0.94


def test_vignetting_and_paint_leave_no_hole():
    red = photograph()
    red[:, 64:264] *= np.linspace(1, 0.25, 200, dtype=np.float32)
    red[60:90, 150:] *= 0.5
    assert panel_only(lit_region(red, CARRIER)) > 0.94


def test_a_hole_is_left_out():
    red = photograph()
    red[70:110, 140:200] = 5
    region = lit_region(red, CARRIER)
    assert not region[72:108, 142:198].any()
    assert region[40:60, 80:250].all()


@pytest.mark.parametrize('red', [photograph(amplitude=2), 0 * photograph()])
def test_without_fringes_it_is_too_dark(red):
    with pytest.raises(TooDarkError, match='expose longer'):
        lit_region(red, CARRIER)


def test_a_white_image_is_saturated():
    with pytest.raises(SaturatedError, match='100% of it is clipped'):
        lit_region(0 * photograph() + 255, CARRIER)


def test_fringes_with_flat_tops_are_kept_and_lost_ones_are_not():
    red = photograph(120, 150)
    red[:, 200:] += 150
    red = red.clip(0, 255)
    region = lit_region(photograph(), CARRIER)
    lost = clipped(red, region, CARRIER)
    assert not lost[:, :190].any()
    assert lost[region][abs(np.nonzero(region)[1] - 235) < 20].all()


def test_clipping_of_most_of_the_region_is_refused():
    region = lit_region(photograph(), CARRIER)
    with pytest.raises(SaturatedError, match=r'clipped over 100% .* shorter'):
        clipped(np.full(region.shape, 255, np.float32), region, CARRIER)


def test_valleys_of_the_modulation_and_dirt_are_not_trusted():
    modulation = np.full((9, 200), 60, np.float32)
    modulation[:, 120:] = 20  # paint: a step, not a valley
    modulation[:, 58:63] = 25  # a seam
    modulation[0] = 3
    explained = np.ones(modulation.shape, bool)
    explained[4, 80:100] = False
    inside = np.ones(modulation.shape, bool)
    inside[8] = False
    mask = trusted(modulation, inside, explained, CARRIER)
    assert not mask[0].any()
    assert not mask[8].any()
    assert not mask[1:8, 58:63].any()
    assert mask[1:3, 65:].all()
    assert not mask[4, 86:94].any()
    assert mask[4, 101:].all()


def test_window_pads_and_gives_back():
    region = np.zeros((20, 100), bool)
    region[3:11, 40:70] = True
    image = np.random.default_rng(0).random((20, 100), np.float32)
    window = Window.around(region, 13)
    assert window.cut(image).shape == (8, 30)
    padded = window.padded(image)
    assert padded.shape[1] >= 30 + 2 * 13
    assert not padded[:, :13].any()
    assert not padded[:, 43:].any()
    np.testing.assert_array_equal(window.bare(padded), image[3:11, 40:70])
