"""What a scene file can ask for, as the skin that comes of it."""

import numpy as np
import pytest
import yaml

from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.files import find
from ftp_dent_ros.simulation.world import read_world
from ftp_dent_ros.yaml_file import read_yaml


@pytest.fixture
def world_of(tmp_path):
    """The world of the shipped scene with other panels."""

    def build(panels):
        scene = read_yaml(find('shipped:scene.yaml'), ConfigurationError)
        scene['panels'] = panels
        file = tmp_path / 'scene.yaml'
        file.write_text(yaml.safe_dump(scene))
        return read_world(file)

    return build


def panel(**fields):
    pose = {'translation': [0, 0, 0], 'rpy': [-np.pi / 2, 0, -np.pi / 2]}
    return {'pose': pose, 'extent': [-0.5, 0.5, -0.5, 0.5], **fields}


def test_rivets_stand_in_a_row_of_equal_steps(world_of):
    row = {'first': [-0.02, 0.01], 'step': [0.02, 0.0], 'count': 3, 'radius': 0.003}
    world = world_of([panel(rivet_rows=[row])])
    rivets = world.surface.panels[0].rivets
    np.testing.assert_allclose(
        [(r.x, r.y) for r in rivets], [(-0.02, 0.01), (0, 0.01), (0.02, 0.01)]
    )
    assert {(r.radius, r.groove, r.sigma) for r in rivets} == {(0.003, 80e-6, 250e-6)}


def test_skins_marks_fittings_and_shapes_by_their_names(world_of):
    """Each part is what its class says, and a wrong field is named with its place."""
    place = {'x': 0.0, 'y': 0.0}
    size = {'length': 0.04, 'width': 0.01}
    names = 'smooth', 'cosine', 'gaussian', 'cap', 'flat', 'crater', 'oil_can', 'crease', 'gouge'
    marks = [
        {'kind': 'dirt', 'contrast': 0.2, 'scales': [0.02, 0.005], 'seed': 3},
        {'kind': 'patch', 'tint': 0.5, 'round': True, **place, **size},
        {'kind': 'lettering', 'text': 'NO STEP', 'height': 0.02, 'tint': [1, 0.2, 0.2], **place},
        {'kind': 'scratches', 'count': 4, 'extent': [-0.1, 0.1, -0.1, 0.1]},
    ]
    fields = {
        'dents': [{'shape': name, 'depth': 0.0005, **place, **size} for name in names],
        'paint': {'albedo': 0.7, 'marks': marks},
        'waves': [{'amplitude': 0.0001, 'wavelength': 0.1}],
        'sunlight': [{'level': 0.5, 'edge': [1, 0, 0], 'softness': 0.004}],
        'rivet_rows': [
            {'kind': kind, 'first': [0, 0], 'step': [0.02, 0], 'count': 2}
            for kind in ('flush', 'domed')
        ],
    }
    (skin,) = world_of([panel(**fields)]).surface.panels
    assert len({type(dent.shape) for dent in skin.dents}) == 8
    assert [dent.kind for dent in skin.dents[-2:]] == ['crease', 'gouge']
    assert len(skin.paint.marks) == 7
    assert len(skin.rivets) == 4
    assert (len(skin.waves), len(skin.sunlight)) == (1, 1)
    fields['paint']['marks'][0]['contrast'] = 'much'
    with pytest.raises(ConfigurationError, match=r"marks\[0\].contrast is 'much': give a finite"):
        world_of([panel(**fields)])
    with pytest.raises(ConfigurationError, match=r"shape is 'star': give one of smooth, cosine"):
        world_of([panel(dents=[{'shape': 'star', 'depth': 0.001, **place, **size}])])
