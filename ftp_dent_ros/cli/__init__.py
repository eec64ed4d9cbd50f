"""The command ``ftp-dent``: a module a command, with its `ARGUMENTS` and `run(arguments)`."""

from __future__ import annotations

from typing import Any

Argument = tuple[tuple[str, ...], dict[str, Any]]


def argument(*names: str, **how: Any) -> Argument:
    """An argument of a command: what `argparse.ArgumentParser.add_argument` takes."""
    return names, how
