import numpy as np
import pytest

from ftp_dent_ros.profilometry.least_squares.noise.between_crests import doubt_in_dark

PHASE = np.linspace(0, 2 * np.pi, 720, endpoint=False)
DARK = np.square(np.minimum(np.cos(PHASE), 0))
NOISE = 1e-4


def doubt(misfit, contrast, here=True):
    """Of light that misfits as a function of the fringes' phase, in amplitudes."""
    square = np.square(misfit) + NOISE
    in_dark = (square * DARK).mean() / DARK.mean()
    fields = [np.full((8, 8), each, np.float32) for each in (in_dark, square.mean(), NOISE)]
    if here:
        # Elsewhere is nothing but noise.
        fields[0][:, 1:] = fields[1][:, 1:] = NOISE
    inside = np.ones((8, 8), bool)
    return doubt_in_dark(*fields, np.full((8, 8), contrast, np.float32), inside)[0, 0]


@pytest.mark.parametrize('contrast', [1.0, 0.8, 0.4])
@pytest.mark.parametrize('part', [0.0, 0.05, 0.3])
def test_noise_and_albedo_are_no_doubt(part, contrast):
    # An albedo changes level and fringes alike.
    assert doubt(part * (1 / contrast + np.cos(PHASE)), contrast) == 0


def test_light_where_there_is_none_is_doubt():
    # A second surface, a third of a window, whose fringes lie a quarter beside.
    other = 0.3 * (np.sin(PHASE) - np.cos(PHASE))
    assert doubt(other, 0.95) > 0.4
    assert doubt(0.05 * np.ones_like(PHASE), 0.95) > 0.5


def test_what_is_so_everywhere_is_no_doubt():
    assert doubt(0.1 * np.cos(4 * PHASE), 0.95, here=False) == 0
