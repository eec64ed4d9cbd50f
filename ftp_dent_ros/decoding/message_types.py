"""Message types by name."""

from __future__ import annotations

import importlib
from typing import Any

from ftp_dent_ros.errors import ConfigurationError


def message_class(type_name: str) -> type[Any]:
    """Class of a message type such as ``sensor_msgs/msg/Image``.

    Raises
    ------
    ConfigurationError
        Its package is not installed.
    """
    package, _, name = type_name.partition('/msg/')
    try:
        return getattr(importlib.import_module(f'{package}.msg'), name)
    except (ImportError, AttributeError, ValueError):
        raise ConfigurationError(
            f'{type_name}: this message type is not installed: install or source its package'
        ) from None
