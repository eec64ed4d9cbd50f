"""Making a whole bag of one whose recorder was killed, or whose disk filled.

Its promise: of a bag without footers and metadata, which `rosbags` and `mcap` refuse, every whole
message comes back.
"""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from ftp_dent_ros.errors import BagError
from ftp_dent_ros.recording.metadata import METADATA_FILE
from ftp_dent_ros.recording.salvage import Salvage
from ftp_dent_ros.recording.topic import Message
from ftp_dent_ros.recording.writer import BagWriter


@dataclass(frozen=True)
class Recovery:
    """What was saved and what was not.

    Attributes
    ----------
    message_counts : dict of str to int
        Messages saved, by topic, topics without any included.
    cut : dict of str to int
        Bytes at the end of files, by file name, that hold no whole message; only files that have
        such bytes.
    damaged : int
        Chunks left out because their checksum is wrong, and unreadable records.
    skipped : dict of str to str
        Files left out as a whole, with the reason.
    whole : bool
        The bag was whole, and the new one is a copy.
    """

    message_counts: dict[str, int]
    cut: dict[str, int]
    damaged: int
    skipped: dict[str, str]
    whole: bool


def recover(
    bag: Path, output: Path, progress: Callable[[int], object] = lambda size: None
) -> Recovery:
    """Write a new whole bag with every whole message of `bag`, which is left as it is.

    Parameters
    ----------
    bag : Path
        Folder or ``.mcap`` file.
    output : Path
        Folder of the new bag; appears when it is complete, and must not exist.
    progress : callable, optional
        Called with each number of bytes read.

    Raises
    ------
    BagError
        Nothing there is an MCAP file, or the output exists or cannot be written.
    """
    files = mcap_files(bag)
    if output.exists():
        raise BagError(
            f'{output}: exists already and is not overwritten: choose another output folder'
        )
    aside = output.with_name(f'.{output.name}.{os.getpid()}')
    try:
        recovery = _recover(bag, files, aside, Path(os.path.abspath(output)).name, progress)
        os.rename(aside, output)
    except BagError as error:
        raise BagError(str(error).replace(str(aside), str(output))) from None
    finally:
        shutil.rmtree(aside, ignore_errors=True)
    return recovery


def mcap_files(bag: Path) -> list[Path]:
    """The MCAP files of a bag's folder in the order of recording, or the one file given.

    Raises
    ------
    BagError
        There is none.
    """
    if bag.is_file():
        return [bag]
    files = sorted(bag.glob('*.mcap'), key=_number)
    if not files:
        what = 'holds no MCAP file' if bag.is_dir() else 'no such bag'
        raise BagError(f'{bag}: {what}: check the path')
    return files


def _recover(
    bag: Path, files: list[Path], aside: Path, name: str, progress: Callable[[int], object]
) -> Recovery:
    cut: dict[str, int] = {}
    skipped: dict[str, str] = {}
    damaged = 0
    whole = bag.is_file() or (bag / METADATA_FILE).is_file()
    with BagWriter(aside, name) as writer:
        for path in files:
            try:
                salvage = Salvage(path)
            except BagError as reason:
                skipped[path.name] = str(reason)
                continue
            if writer.message_count:
                writer.split()
            writer.write(_announced(salvage, writer, progress))
            for topic in salvage.topics.values():
                writer.add_topic(topic)
            if salvage.cut:
                cut[path.name] = salvage.cut
            damaged += salvage.damaged
            whole = whole and salvage.whole
        if len(skipped) == len(files):
            raise BagError(next(iter(skipped.values())))
    counts = {topic.name: writer.message_counts[topic.name] for topic in writer.topics}
    return Recovery(counts, cut, damaged, skipped, whole and not skipped and not damaged)


def _announced(
    salvage: Salvage, writer: BagWriter, progress: Callable[[int], object]
) -> Iterator[Message]:
    for message in salvage.messages():
        writer.add_topic(salvage.topics[message.topic])
        progress(len(message.data))
        yield message


def _number(path: Path) -> tuple[int, str]:
    digits = re.search(r'(\d+)$', path.stem)
    return (int(digits.group(1)) if digits else 0, path.name)
