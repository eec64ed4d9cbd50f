import subprocess
import sys

import pytest

from ftp_dent_ros.cli.main import main


def test_keys_are_made_once(tmp_path, capsys):
    pytest.importorskip('cryptography', reason='cryptography is not installed: no keys are made')
    assert main(['ground', '--make-keys', str(tmp_path / 'keys')]) == 0
    assert 'Copy authority.pem, drone.pem and drone.key to the drone' in capsys.readouterr().out
    assert main(['ground', '--make-keys', str(tmp_path / 'keys')]) == 2
    assert 'holds files already' in capsys.readouterr().err


@pytest.mark.parametrize(
    'words, what',
    [
        ([], "the drone's address is missing"),
        (['192.0.2.1'], 'without keys anybody'),
        (['a b'], 'no address of a link'),
        (['192.0.2.1', '--keys', 'nowhere'], 'ground.key are not there'),
    ],
)
def test_what_cannot_be_used_is_told_in_one_line(words, what, capsys):
    assert main(['ground', *words]) == 2
    said = capsys.readouterr().err
    assert what in said and said.count('\n') == 1


def test_without_ros_there_is_the_page(tmp_path):
    """The command where rclpy cannot be imported."""
    pytest.importorskip('zenoh', reason='Zenoh is not installed: the link is not tested')
    program = (
        'import importlib.util as u, sys; find = u.find_spec\n'
        'u.find_spec = lambda name, *rest: None if name == "rclpy" else find(name, *rest)\n'
        'from ftp_dent_ros.cli.main import main\n'
        'sys.exit(main(["ground", "127.0.0.1:9", "--web", "127.0.0.1:0"]))'
    )
    process = subprocess.Popen(
        [sys.executable, '-c', program], stdout=subprocess.PIPE, text=True, cwd=tmp_path
    )
    line = process.stdout.readline()
    process.terminate()
    assert line.startswith('what comes is shown at http://127.0.0.1:') and 'no ROS here' in line
    assert process.wait(60) == 0
