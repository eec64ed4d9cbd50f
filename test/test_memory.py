"""Memory that is freed stays with the process."""

from __future__ import annotations

import platform
import subprocess
import sys

import pytest

# Blocks of a megabyte, together as large as a cloud and its messages, photograph by photograph.
SCRIPT = """
import resource
{first}

def faults():
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    for _ in range(10):
        blocks = [b'.' * (1 << 20) for _ in range(28)]
        del blocks
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before

faults()
print(faults())
"""


def faults(first: str = '') -> int:
    found = subprocess.run(
        [sys.executable, '-c', SCRIPT.format(first=first)],
        capture_output=True,
        text=True,
        check=True,
    )
    return int(found.stdout)


@pytest.mark.skipif(platform.libc_ver()[0] != 'glibc', reason="it is glibc's malloc")
def test_nodes_do_not_fetch_the_same_memory_again_and_again():
    assert faults('import ftp_dent_ros.nodes') < 100
    # Without it, each of ten photographs fetches its 28 MB anew.
    assert faults() > 10_000
