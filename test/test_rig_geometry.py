"""Rigs that cannot be are refused before they measure anything."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ftp_dent_ros.errors import RigError
from ftp_dent_ros.files import find
from ftp_dent_ros.rig.rig import Lens, read_rig, write_rig

RIG = read_rig(find('shipped:rig.yaml'))


def with_matrix(lens: Lens, **changed: float) -> Lens:
    places = {'f_x': (0, 0), 'f_y': (1, 1), 'c_x': (0, 2), 'c_y': (1, 2)}
    matrix = lens.camera_matrix.copy()
    for name, value in changed.items():
        matrix[places[name]] = value
    return dataclasses.replace(lens, camera_matrix=matrix)


def beside(centre, axis, degrees):
    """The shipped lenses, the projector at `centre` of the camera's frame and turned."""
    turn = Rotation.from_euler(axis, degrees, degrees=True).as_matrix()
    return dataclasses.replace(RIG, rotation=turn, translation=-turn @ np.array(centre))


@pytest.mark.parametrize(
    ('rig', 'words'),
    [
        (
            dataclasses.replace(RIG, translation=1e3 * RIG.translation),
            'seems to be in millimetres',
        ),
        (dataclasses.replace(RIG, translation=1e-3 * RIG.translation), 'baseline of 0.000247'),
        (dataclasses.replace(RIG, camera=with_matrix(RIG.camera, f_x=8.0, f_y=8.0)), 'in pixels'),
        (dataclasses.replace(RIG, projector=with_matrix(RIG.projector, f_x=1e6)), 'in pixels'),
        (dataclasses.replace(RIG, camera=with_matrix(RIG.camera, f_y=500.0)), 'far from each'),
        (dataclasses.replace(RIG, camera=with_matrix(RIG.camera, c_x=-9e3)), 'principal point'),
        (beside((0.25, 0, 0), 'y', 180), 'turn the projector away'),
        (beside((0.25, 0, 0), 'y', -60), 'turn the projector away'),
        (beside((0, 0.02, 0.25), 'x', 4), 'behind or before the camera'),
    ],
)
def test_what_cannot_be_is_refused(tmp_path, rig, words):
    write_rig(tmp_path / 'rig.yaml', rig)
    with pytest.raises(RigError, match=words) as caught:
        read_rig(tmp_path / 'rig.yaml')
    assert str(caught.value).startswith(f'{tmp_path}/rig.yaml: ')
