"""``ftp-dent recover``: a whole bag from one whose recorder was killed."""

from __future__ import annotations

import argparse
from pathlib import Path

from tqdm import tqdm

from ftp_dent_ros.cli import argument
from ftp_dent_ros.errors import printable
from ftp_dent_ros.recording.recovery import Recovery, mcap_files, recover

ARGUMENTS = (
    argument('bag', type=Path, help='folder of the bag, or an .mcap file'),
    argument(
        '-o', '--output', type=Path, required=True, help='folder of the new bag: must not exist'
    ),
)


def run(arguments: argparse.Namespace) -> int:
    """Write the new bag and say what was saved; the old one is left as it is."""
    size = sum(path.stat().st_size for path in mcap_files(arguments.bag))
    with tqdm(total=size, unit='B', unit_scale=True, disable=None, leave=False) as bar:
        recovery = recover(arguments.bag, arguments.output, bar.update)
    _report(recovery, arguments)
    return 0


def _report(recovery: Recovery, arguments: argparse.Namespace) -> None:
    counts = recovery.message_counts
    print(f'{arguments.output}: {sum(counts.values())} messages of {len(counts)} topics')
    for topic in sorted(counts):
        print(f'  {counts[topic]:8d}  {printable(topic)}')
    for name, size in recovery.cut.items():
        print(f'{printable(name)}: cut {size} bytes at the end, which hold no whole message')
    if recovery.damaged:
        print(f'left out {recovery.damaged} damaged chunks or records')
