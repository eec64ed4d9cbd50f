"""Several inputs of the command: side by side; told where they fail."""

import json

from dent_samples import noisy_cloud

from ftp_dent_ros.cli.main import main
from ftp_dent_ros.cloud.ply import write_ply

FILES = ('dents.json', 'dents.csv', 'report.html')


def dents(folder):
    record = json.loads((folder / 'dents.json').read_text())
    del record['source'], record['written']
    return record


def test_several_inputs_are_inspected_as_each_alone(tmp_path, capsys):
    paths = [tmp_path / flight / 'cloud.ply' for flight in ('monday', 'tuesday')]
    for seed, path in enumerate(paths):
        path.parent.mkdir()
        write_ply(path, noisy_cloud(seed=seed), 'camera_optical_frame')
    broken = tmp_path / 'broken.ply'
    broken.write_text('x')
    out = tmp_path / 'out'
    words = ['inspect', *map(str, paths), str(broken), '--output', str(out), '--jobs', '2']
    assert main(words) == 2
    told = capsys.readouterr()
    assert told.out.splitlines()[-1] == '2 inspected, 1 failed'
    (line,) = [line for line in told.err.splitlines() if 'not a PLY file' in line]
    assert line.count(str(broken)) == 1
    folders = [out / 'monday/cloud', out / 'tuesday/cloud']
    for folder in folders:
        assert {each.name for each in folder.iterdir()} == set(FILES)
    assert main(['inspect', str(paths[1]), '--output', str(tmp_path / 'alone')]) == 0
    assert dents(folders[1]) == dents(tmp_path / 'alone')
    capsys.readouterr()
    assert main([*words, '--survey', '--jobs', '1']) == 2
    assert capsys.readouterr().out.splitlines()[-1] == '0 inspected, 3 failed'


def test_the_same_input_twice_and_no_jobs_are_refused(tmp_path, capsys):
    out = ('--output', str(tmp_path / 'out'))
    assert main(['inspect', 'a.ply', './a.ply', *out]) == 2
    assert 'given 2 times' in capsys.readouterr().err
    assert main(['inspect', 'a.ply', '--jobs', '0', *out]) == 2
    assert '--jobs is 0' in capsys.readouterr().err
