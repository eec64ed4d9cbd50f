"""What becomes of a measurement: its result, a refusal, or a crash."""

from __future__ import annotations

import traceback
from collections.abc import Callable
from typing import Protocol, TypeVar

from ftp_dent_ros.errors import FtpDentError

Given = TypeVar('Given')


class Tells(Protocol):
    """What takes the reason: empty strings where there is none."""

    refused: str
    crashed: str


def attempt(measure: Callable[[], Given], result: Tells) -> Given | None:
    """What a call gives; None where it refuses or crashes, and `result` tells which, and why."""
    try:
        return measure()
    except FtpDentError as reason:
        result.refused = str(reason)
    except Exception as defect:
        last = traceback.extract_tb(defect.__traceback__)[-1]
        result.crashed = f'{defect!r} at {last.filename.rpartition("/")[2]}:{last.lineno}'
    return None
