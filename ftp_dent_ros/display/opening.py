"""Which display shows the pattern."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

WINDOW, DRM = DISPLAYS = ('window', 'drm')


@dataclass(frozen=True)
class DisplaySettings:
    """Where the pattern is shown; `corner` in pixels of the desktop."""

    enabled: bool = False
    kind: str = WINDOW
    corner: tuple[int, int] = (0, 0)
    device: str = '/dev/dri/card0'
    connector: str = ''


class Display(Protocol):
    """What shows RGB pixels one to one; `trouble` says what is wrong with it, or is empty."""

    trouble: str

    def show(self, image: NDArray[np.uint8]) -> None:
        """Show RGB pixels of shape (height, width, 3)."""

    def refresh(self) -> None:
        """Serve the display; light it again if it comes back."""

    def close(self) -> None:
        """Let go of it."""


def open_display(settings: DisplaySettings, size: tuple[int, int]) -> Display:
    """Open a display for a pattern of a width and height.

    Raises
    ------
    ConfigurationError
        It cannot be opened.
    """
    # Imported only as far as wanted.
    if settings.kind == DRM:
        from ftp_dent_ros.display.drm import DrmDisplay

        return DrmDisplay(settings.device, settings.connector, size)
    from ftp_dent_ros.display.window import Window

    return Window(*settings.corner, size)
