"""Plain data is read from YAML files, and nothing else."""

import pytest

from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.yaml_file import read_yaml


@pytest.mark.parametrize(
    ('text', 'said'),
    [
        ('a: 1\nb: 2024-02-31', "line 2 ('2024-02-31' is no timestamp)"),
        ('a: [1, !!int abc]', "line 1 ('abc' is no int)"),
        ('a: !!bool maybe', 'is no bool'),
        ('a: !!timestamp now', 'is no timestamp'),
        ('a: !!int ""', 'is no int'),
        ('a: !!python/object/apply:os.getcwd []', 'python/object'),
        ('a: ' + '[' * 1000, 'nested too deeply'),
        ('\n'.join(' ' * k + 'a:' for k in range(1200)), 'nested too deeply'),
        (f'a: {"9" * 401}', 'more than 64 bits'),
        (f'a: {"9" * 5000}', 'is no int'),
        ('1: x', 'the key 1 is no text'),
        ('? [x]\n: 1', 'unhashable'),
        ('a: 1\na: 2', "'a' is there 2 times"),
        ('a: \0', 'not valid YAML'),
        ('- a', 'no mapping'),
    ],
)
def test_hostile_yaml_is_refused_with_one_short_sentence(tmp_path, text, said):
    path = tmp_path / 'settings.yaml'
    path.write_text(text)
    with pytest.raises(ConfigurationError) as caught:
        read_yaml(path, ConfigurationError)
    sentence = str(caught.value)
    assert said in sentence and sentence.startswith(f'{path}: ')
    assert '\n' not in sentence and len(sentence) < len(str(path)) + 200


def test_harmless_aliases_are_read(tmp_path):
    path = tmp_path / 'settings.yaml'
    path.write_text('a: &a {x: [1, 2]}\nb: {<<: *a, y: *a}\nid: 123e45')
    assert read_yaml(path, ConfigurationError)['id'] == '123e45', 'no number, for what is written'
    assert read_yaml(path, ConfigurationError)['b'] == {'x': [1, 2], 'y': {'x': [1, 2]}}
