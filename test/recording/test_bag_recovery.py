import io
from pathlib import Path

import pytest
from bag_samples import sample_messages, write_sample
from mcap.reader import SeekingReader
from rosbags.rosbag2 import Reader

from ftp_dent_ros.cli.recover import recover
from ftp_dent_ros.errors import BagError
from ftp_dent_ros.recording.reader import open_bag

MESSAGES = sample_messages(14)


@pytest.fixture
def bag(tmp_path) -> Path:
    write_sample(tmp_path / 'bag', MESSAGES)
    return tmp_path / 'bag'


def killed(folder: Path, data: bytes) -> Path:
    """Folder as a killed recorder leaves it."""
    folder.mkdir()
    (folder / f'{folder.name}_0.mcap').write_bytes(data)
    return folder


def chunk_ends(data: bytes) -> list[int]:
    """Offset behind each chunk of three messages."""
    with io.BytesIO(data) as stream:
        chunks = SeekingReader(stream).get_summary().chunk_indexes
    return [chunk.chunk_start_offset + chunk.chunk_length for chunk in chunks]


def test_a_file_cut_at_any_byte_gives_back_every_whole_chunk(tmp_path, bag):
    data = (bag / 'bag_0.mcap').read_bytes()
    ends = chunk_ends(data)
    for number, cut in enumerate({*range(ends[0], len(data), 411), *ends, len(data)}):
        path = tmp_path / 'cut.mcap'
        path.write_bytes(data[:cut])
        recovery = recover(path, tmp_path / f'new{number}')
        saved = list(open_bag(tmp_path / f'new{number}').messages())
        assert saved == MESSAGES[: 3 * len([end for end in ends if end <= cut])], cut
        assert recovery.damaged == 0


def test_the_new_bag_is_whole_and_the_old_one_untouched(tmp_path, bag):
    data = (bag / 'bag_0.mcap').read_bytes()
    old = killed(tmp_path / 'old', data[: chunk_ends(data)[3] + 40])
    recovery = recover(old, tmp_path / 'new')
    assert recovery.message_counts == {'/words': 6, '/poses': 6}
    assert 0 < recovery.cut['old_0.mcap'] <= 40
    assert (old / 'old_0.mcap').read_bytes() == data[: chunk_ends(data)[3] + 40]
    names = sorted(path.name for path in (tmp_path / 'new').iterdir())
    assert names == ['metadata.yaml', 'new_0.mcap']
    # Types, hashes and quality of service too.
    assert open_bag(tmp_path / 'new').topics == open_bag(bag).topics[:2]
    with Reader(tmp_path / 'new') as reader:
        assert reader.message_count == 12


@pytest.mark.parametrize('garbage', [bytes(1000), b'\xff' * 1000, bytes(range(1, 250))])
def test_garbage_at_the_end_is_cut(tmp_path, bag, garbage):
    data = (bag / 'bag_0.mcap').read_bytes()
    old = killed(tmp_path / 'old', data[: chunk_ends(data)[-1]] + garbage)
    recovery = recover(old, tmp_path / 'new')
    assert list(open_bag(tmp_path / 'new').messages()) == MESSAGES
    assert recovery.cut == {'old_0.mcap': len(garbage)}


def test_a_chunk_with_a_wrong_checksum_is_left_out_and_counted(tmp_path, bag):
    path = bag / 'bag_0.mcap'
    data = bytearray(path.read_bytes())
    data[data.index(b'   6xxxxxx') + 5] ^= 1
    path.write_bytes(data)
    recovery = recover(bag, tmp_path / 'new')
    assert recovery.damaged == 1
    assert list(open_bag(tmp_path / 'new').messages()) == [*MESSAGES[:6], *MESSAGES[9:]]


def test_a_bag_of_several_files_becomes_one(tmp_path):
    messages = sample_messages(300)
    (tmp_path / 'bag').mkdir()
    count = 12  # so that their order is not the alphabet's
    for number in range(count):
        write_sample(tmp_path / str(number), messages[25 * number : 25 * number + 25])
        part = tmp_path / str(number) / f'{number}_0.mcap'
        part.rename(tmp_path / 'bag' / f'bag_{number}.mcap')
    # The recorder was killed as it began the next one.
    (tmp_path / 'bag' / f'bag_{count}.mcap').write_bytes(b'')
    recover(tmp_path / 'bag', tmp_path / 'new')
    assert list(open_bag(tmp_path / 'new').messages()) == messages


@pytest.mark.parametrize('content', [b'', b'SQLite format 3\0'])
def test_what_cannot_be_recovered(tmp_path, content):
    (tmp_path / 'x.mcap').write_bytes(content)
    for bag in (tmp_path / 'x.mcap', killed(tmp_path / 'old', content)):
        with pytest.raises(BagError, match='nothing to recover'):
            recover(bag, tmp_path / 'new')
    with pytest.raises(BagError, match='no such bag'):
        recover(tmp_path / 'nothing', tmp_path / 'new')
    assert sorted(path.name for path in tmp_path.iterdir()) == ['old', 'x.mcap']


def test_a_bag_has_its_name_only_when_it_is_whole(tmp_path, bag):
    there = []
    recover(bag, tmp_path / 'new', lambda size: there.append((tmp_path / 'new').exists()))
    assert there and not any(there)
    assert {path.name for path in tmp_path.iterdir()} == {bag.name, 'new'}


def test_an_output_that_exists_is_not_touched(tmp_path, bag):
    (tmp_path / 'new').mkdir()
    with pytest.raises(BagError, match='exists already'):
        recover(bag, tmp_path / 'new')
    assert list((tmp_path / 'new').iterdir()) == []


def test_a_disk_too_small_for_the_new_bag(tmp_path, small_disk):
    write_sample(
        tmp_path / 'bag',
        [message._replace(data=message.data + bytes(100_000)) for message in MESSAGES],
    )
    with pytest.raises(BagError, match=f'^{small_disk}/new: cannot be written .No space'):
        recover(tmp_path / 'bag', small_disk / 'new')
    assert list(small_disk.iterdir()) == []
