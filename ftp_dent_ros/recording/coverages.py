"""What of the lit skin has points in the clouds of a bag, as far as its diagnostics tell it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from ftp_dent_ros.profilometry.coverage import Coverage
from ftp_dent_ros.recording.provenance import diagnostics_of
from ftp_dent_ros.recording.reader import Bag

#: Name of the stamp, nanoseconds, of the cloud that the shares in the diagnostics are of.
NOTED_STAMP = 'lit area at (ns)'


def coverages_of(bag: Bag) -> dict[int, Coverage]:
    """Coverage of a bag's clouds by their stamps, nanoseconds.

    ``reconstruction`` tells that of the worst cloud of each second, so that the others are no
    worse.
    """
    return {stamp: coverage for array in diagnostics_of(bag) for stamp, coverage in _told(array)}


def _told(array: Any) -> Iterator[tuple[int, Coverage]]:
    for status in array.status:
        values = {str(item.key): str(item.value) for item in status.values}
        stamp, coverage = values.get(NOTED_STAMP, ''), Coverage.noted(values)
        if coverage is not None and stamp.isdecimal():
            yield int(stamp), coverage
