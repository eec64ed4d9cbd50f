"""What a scene file can ask for, as the skin that comes of it."""

import numpy as np
import pytest
import yaml

from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.files import find
from ftp_dent_ros.simulation.world import read_world
from ftp_dent_ros.yaml_file import read_yaml


@pytest.fixture
def world_with(tmp_path):
    """The world of the shipped scene with another value at a path; None leaves the field out."""

    def build(path, value):
        scene = block = read_yaml(find('shipped:scene.yaml'), ConfigurationError)
        *parents, name = path
        for parent in parents:
            block = block[parent]
        block[name] = value
        if value is None:
            del block[name]
        file = tmp_path / 'scene.yaml'
        file.write_text(yaml.safe_dump(scene))
        return read_world(file)

    return build


@pytest.mark.parametrize(
    ('path', 'value', 'words'),
    [
        (['panels'], [], 'panels is []: give one panel or more'),
        (['panels', 0, 'extent'], [1, 0, 0, 1], 'extent is (1.0, 0.0, 0.0, 1.0): give x_min'),
        (['panels', 0, 'pose'], None, 'panels[0].pose is missing: add it'),
        (['panels', 0, 'pose', 'rpy'], [0, 0], 'pose.rpy is [0, 0]: give 3 finite numbers'),
        (['panels', 0, 'dents', 1, 'width'], 0, 'dents[1].width is 0: give a finite number'),
        (
            ['panels', 0, 'dents', 1, 'shape'],
            'star',
            "shape is 'star': give one of smooth",
        ),
        (['panels', 0, 'rivet_rows', 0, 'count'], 1.5, 'rivet_rows[0].count is 1.5: give a'),
        (['panels', 0, 'paint', 'marks', 0, 'contrast'], 'much', "marks[0].contrast is 'much': "),
        (['flight', 'wobble'], [0, 0, 2], 'flight.wobble is [0, 0, 2]: give 3 finite numbers'),
        (['weather'], 'fine', 'weather is unknown: remove it'),
    ],
)
def test_a_wrong_field_is_named_in_one_sentence(world_with, tmp_path, path, value, words):
    with pytest.raises(ConfigurationError) as refusal:
        world_with(path, value)
    sentence = str(refusal.value)
    assert sentence.startswith(f'{tmp_path}/scene.yaml: ') and '\n' not in sentence
    assert words in sentence


def test_skins_marks_fittings_and_shapes_by_their_names(world_with):
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
            {'kind': kind, 'first': [-0.02, 0.01], 'step': [0.02, 0], 'count': 2, 'radius': 0.003}
            for kind in ('flush', 'domed')
        ],
    }
    pose = {'translation': [0, 0, 0], 'rpy': [-np.pi / 2, 0, -np.pi / 2]}
    whole = {'pose': pose, 'extent': [-0.5, 0.5, -0.5, 0.5], **fields}
    (skin,) = world_with(['panels'], [whole]).surface.panels
    assert len({type(dent.shape) for dent in skin.dents}) == 8
    assert [dent.kind for dent in skin.dents[-2:]] == ['crease', 'gouge']
    assert len(skin.paint.marks) == 7
    assert [(each.x, each.y) for each in skin.rivets] == 2 * [(-0.02, 0.01), (0, 0.01)]
    flush = skin.rivets[0]
    assert (flush.radius, flush.groove, flush.sigma) == (0.003, 80e-6, 250e-6)
    assert (len(skin.waves), len(skin.sunlight)) == (1, 1)
