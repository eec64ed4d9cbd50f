"""Which topics of many are wanted, in the words of ``ros2 bag``: the libraries choose none."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from ftp_dent_ros.errors import ConfigurationError

# Of an absolute topic, as ROS 2 takes them.
_NAME = re.compile(r'(/[A-Za-z_][A-Za-z0-9_]*)+')


@dataclass(frozen=True)
class Selection:
    """Topics chosen by name or by regular expression, as ``ros2 bag`` does it.

    Attributes
    ----------
    names : tuple of str
        Wanted in any case; a name without a leading slash is taken from the root namespace.
    everything : bool
        All topics, but not hidden ones (a part of the name begins with ``_``).
    regex, exclude_regex : str
        Searched for in the names of topics that are not hidden; '' for none.

    Raises
    ------
    ConfigurationError
        A name or an expression is malformed.
    """

    names: tuple[str, ...] = ()
    everything: bool = False
    regex: str = ''
    exclude_regex: str = ''

    def __post_init__(self) -> None:
        _check(self.regex)
        _check(self.exclude_regex)

    @classmethod
    def of(cls, names: Sequence[str], **others: bool | str) -> Selection:
        """Selection with the names made absolute."""
        absolute = [name if name.startswith('/') else f'/{name}' for name in names]
        for name in absolute:
            if not _NAME.fullmatch(name):
                raise ConfigurationError(
                    f'{name!r} is no name of a topic: give letters, digits, _ and / alone, or a '
                    'regular expression with --regex'
                )
        return cls(tuple(dict.fromkeys(absolute)), **others)  # type: ignore[arg-type]

    def wants(self, topic: str) -> bool:
        """Whether a topic is chosen."""
        if topic in self.names:
            return True
        if any(part.startswith('_') for part in topic.split('/')):
            return False
        if self.exclude_regex and re.search(self.exclude_regex, topic):
            return False
        return self.everything or bool(self.regex and re.search(self.regex, topic))


def _check(expression: str) -> None:
    try:
        re.compile(expression)
    except re.error as reason:
        raise ConfigurationError(
            f'{expression!r} is no regular expression ({reason}): correct it'
        ) from None
