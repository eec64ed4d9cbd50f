import re
import subprocess
import sys
from collections import Counter

import pytest
from bag_samples import sample_messages, write_sample

from ftp_dent_ros.cli.main import main
from ftp_dent_ros.recording.reader import open_bag

MESSAGES = sample_messages(10)


@pytest.fixture
def bag(tmp_path):
    write_sample(tmp_path / 'bag', MESSAGES)
    return tmp_path / 'bag'


def test_recover_says_what_was_saved_and_what_was_cut(tmp_path, bag, capsys):
    (bag / 'metadata.yaml').unlink()
    path = bag / 'bag_0.mcap'
    path.write_bytes(path.read_bytes()[:2500])
    assert main(['recover', str(bag), '--output', str(tmp_path / 'new')]) == 0
    saved = list(open_bag(tmp_path / 'new').messages())
    assert saved == MESSAGES[: len(saved)]
    output = capsys.readouterr().out
    assert output.startswith(f'{tmp_path}/new: {len(saved)} messages of 2 topics\n')
    counts = Counter(message.topic for message in saved)
    assert [line.split() for line in output.splitlines()[1:3]] == [
        [str(counts['/poses']), '/poses'],
        [str(counts['/words']), '/words'],
    ]
    assert re.fullmatch(
        r'bag_0\.mcap: cut \d+ bytes at the end, which hold no whole message',
        output.splitlines()[3],
    )
    assert len(output.splitlines()) == 4


@pytest.mark.parametrize('missing', ['mcap', 'rosbags'])
def test_without_the_libraries_the_commands_say_what_to_do(missing):
    code = (
        f'import sys; sys.modules[{missing!r}] = None; '
        "from ftp_dent_ros.cli.main import main; sys.exit(main(['record', '/points']))"
    )
    result = subprocess.run(
        [sys.executable, '-c', code], capture_output=True, text=True, check=False
    )
    assert result.returncode == 2
    (line,) = result.stderr.splitlines()
    assert line.startswith('ftp-dent record: needs the Python package ')
    if 'rclpy' not in line:
        assert f'{missing}, which is not installed' in line
        assert "`pip install '.[bags]'`" in line
        assert '`ros2 bag`' in line
