"""The end of recording that speaks ROS: topics into a bag, a bag onto topics."""

from __future__ import annotations

import sys

from ftp_dent_ros.errors import printable


def say(text: str) -> None:
    """Tell the user a line."""
    print(printable(text), file=sys.stderr, flush=True)
