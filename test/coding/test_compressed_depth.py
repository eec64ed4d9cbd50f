import numpy as np
import pytest
from skins import depths_of, skin

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.coding.compressed_depth import depth_image
from ftp_dent_ros.errors import CodecError


def flat(z):
    z = np.asarray(z, np.float32)
    return Cloud(np.stack([z, z, z], axis=2), np.zeros(z.shape, 'f4'))


@pytest.mark.parametrize('distance', [0.3, 0.8, 2.0])
def test_the_error_is_within_the_stated_limit(view, distance):
    cloud = skin(view, distance=distance)
    z = cloud.points[..., 2].astype(float)
    back = depths_of(depth_image(cloud))
    np.testing.assert_array_equal(np.isnan(back), np.isnan(z))
    near, far = np.nanmin(z), np.nanmax(z)
    # float32 in the header and in what is shown add their own rounding.
    limit = z**2 * (1 / near - 1 / far) / 131068 * 1.01 + 3e-7 * z * z / (far - near) * 0.1 + 1e-6
    assert (np.abs(back - z)[np.isfinite(z)] < limit[np.isfinite(z)]).all()


def test_one_depth_and_a_large_range():
    np.testing.assert_allclose(depths_of(depth_image(flat(np.full((4, 5), 0.7)))), 0.7, rtol=1e-5)
    z = np.linspace(0.3, 3, 200).reshape(10, 20)
    back = depths_of(depth_image(flat(z)))
    assert np.abs(back - z).max() < 2.2e-4


def test_a_cloud_without_depths_is_refused():
    with pytest.raises(CodecError):
        depth_image(flat(np.full((3, 3), np.nan)))
