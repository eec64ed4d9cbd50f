"""The image of the skin, against the paint that was photographed."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from small_scenes import PATTERN, RIG, Scene, panel

from ftp_dent_ros.photograph.photograph import Photograph
from ftp_dent_ros.profilometry import Reconstructor, Settings
from ftp_dent_ros.profilometry.skin_image import SkinImager
from ftp_dent_ros.simulation import Paint
from ftp_dent_ros.simulation.paint import Dirt, PaintPatch

MARKS = (
    Dirt(0.15, scales=(0.03, 0.012), seed=5),
    PaintPatch(0.03, 0.02, 0.02, 0.006, (0.6, 0.6, 0.6), angle=0.5),
)


@pytest.fixture(scope='module')
def seen():
    """A photograph of a marked skin, its measurement, and the paint that each point shows."""
    skin = panel(dents=(), paint=Paint(albedo=0.7, marks=MARKS))
    scene = Scene.of(skin)
    measured = Reconstructor(RIG, PATTERN, Settings(stride=2)).measure(scene.image, skin=True)
    x, y, _ = np.moveaxis(skin.pose.inverse().apply(measured.cloud.points), -1, 0)
    known = measured.cloud.valid
    place = np.nan_to_num(x).astype(np.float32), np.nan_to_num(y).astype(np.float32)
    # The marks are grey.
    factors = [np.broadcast_to(mark.factor(*place), (3, *x.shape))[0] for mark in MARKS]
    paint = np.prod(factors, axis=0)
    return scene, measured, paint, known


def test_skin_lies_on_the_cloud_and_nowhere_else(seen):
    _, measured, _, known = seen
    assert measured.cloud.skin.dtype == np.uint8
    assert ((measured.cloud.skin > 0) == known).all()


def test_skin_shows_the_paint_and_not_the_fringes(seen):
    _, measured, paint, known = seen
    inner = known.copy()
    inner[:8] = inner[-8:] = inner[:, :8] = inner[:, -8:] = False
    inner &= np.roll(known, 8, 1) & np.roll(known, -8, 1)
    bare = Scene.of(panel(dents=(), paint=Paint(albedo=0.7)))
    light = (
        Reconstructor(RIG, PATTERN, Settings(stride=2)).measure(bare.image, skin=True).cloud.skin
    )
    inner &= light > 0
    skin = measured.cloud.skin[inner] / light[inner]
    true = paint[inner]
    assert np.corrcoef(skin, true)[0, 1] > 0.95
    # Fringes alone have a contrast of 1.
    phase = SkinImager.of(RIG, PATTERN, 2).geometry.phase(1 / measured.cloud.points[..., 2])
    rest = skin - true
    left = 2 * abs(np.mean((rest - rest.mean()) * np.exp(1j * phase[inner])))
    assert left < 0.01


def test_the_stripe_leaves_no_mark(seen):
    _, measured, paint, known = seen
    phase = SkinImager.of(RIG, PATTERN, 2).geometry.phase(
        1 / np.where(known, measured.cloud.points[..., 2], 1)
    )
    ratio = measured.cloud.skin / paint
    inside = known & (np.abs(phase) < np.pi)
    beside = known & (np.abs(phase) > 2 * np.pi) & (np.abs(phase) < 4 * np.pi)
    assert np.median(ratio[inside]) == pytest.approx(np.median(ratio[beside]), rel=0.03)


def test_deeper_pixels_give_the_same_skin(seen):
    scene, measured, _, _ = seen
    deep = Photograph(scene.image.astype(np.uint16) * 257, 65535)
    image = SkinImager.of(RIG, PATTERN, 2).image(deep, measured.cloud)
    assert np.abs(image.astype(int) - measured.cloud.skin).max() <= 2


def test_nobody_pays_for_a_skin_that_nobody_asked_for(seen):
    scene, measured, _, _ = seen
    plain = Reconstructor(RIG, PATTERN, Settings(stride=2)).measure(scene.image)
    assert not plain.cloud.skin.any()
    assert np.array_equal(plain.cloud.points, measured.cloud.points, equal_nan=True)


@pytest.mark.parametrize('blur', [0.4, 0.9])
def test_coded_fringes_leave_no_stripes_whatever_the_lenses_blur(blur):
    coded = replace(PATTERN, code='contrast')
    bare = panel(dents=(), paint=Paint(albedo=0.7))
    scene = Scene.of(bare, projected=coded.draw(), psf_px=blur)
    skin = Reconstructor(RIG, coded, Settings(stride=2)).measure(scene.image, skin=True).cloud
    known = skin.valid
    inner = cv2.erode(known.astype(np.uint8), np.ones((25, 25), np.uint8)) > 0
    light = np.where(known, np.log(np.maximum(skin.skin, 1.0)), 0)
    around = cv2.blur(light, (25, 25)) / np.maximum(cv2.blur(1.0 * known, (25, 25)), 1e-3)
    # Stripes belong to the projector: what its columns have in common is of the fringes.
    phase = SkinImager.of(RIG, coded, 2).geometry.phase(
        1 / np.where(known, skin.points[..., 2], 1)
    )
    column = np.rint(phase[inner] / (2 * np.pi) * coded.period_px).astype(int)
    column -= column.min()
    count = np.bincount(column)
    mean = np.bincount(column, (light - around)[inner])[count > 50] / count[count > 50]
    assert np.std(mean) < 0.002
