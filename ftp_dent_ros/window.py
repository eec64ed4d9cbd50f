"""The projector as a display: a window in full screen, through SDL 2.

Under X11 and Wayland, and on a console without a desktop by the kernel (KMSDRM).
"""

from __future__ import annotations

import ctypes
import importlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.errors import ConfigurationError

_TITLE = b'ftp_dent_ros pattern'


class Window:
    """A window without border, cursor or scaling whose pixels are the pattern's.

    Parameters
    ----------
    x, y : int
        Upper left corner of the display on the desktop, pixels.
    size : (int, int)
        Width and height of the pattern.

    Attributes
    ----------
    trouble : str
        What is wrong with what is shown; empty if nothing is.

    Raises
    ------
    ConfigurationError
        There is no display, or SDL 2 is not installed.
    """

    def __init__(self, x: int, y: int, size: tuple[int, int]) -> None:
        self.trouble = ''
        self._corner, self._size = (x, y), size
        self._image: NDArray[np.uint8] | None = None
        # Whether it is to be drawn, and what was wrong when it was drawn last.
        self._is_stale, self._drawing = True, ''
        self._window: Any = None
        self._sdl = _load()
        self._sdl.SDL_SetHint(b'SDL_VIDEO_X11_NET_WM_BYPASS_COMPOSITOR', b'1')
        self._sdl.SDL_SetHint(b'SDL_VIDEO_MINIMIZE_ON_FOCUS_LOSS', b'0')
        if self._sdl.SDL_Init(self._sdl.SDL_INIT_VIDEO) != 0:
            raise ConfigurationError(
                f'display.enabled is set, but there is no display ({self._error()}): start in a '
                'graphical session (DISPLAY), or on a console as a user of the group video'
            )
        # Without a desktop the pattern's size sets the display's mode.
        self._sets_mode = self._sdl.SDL_GetCurrentVideoDriver() == b'KMSDRM'
        self._sdl.SDL_DisableScreenSaver()
        self.refresh()

    def show(self, image: NDArray[np.uint8]) -> None:
        """Show RGB pixels of shape (height, width, 3)."""
        self._image, self._is_stale = np.ascontiguousarray(image), True
        self.trouble = self._served()

    def refresh(self) -> None:
        """Serve the window; open it again if it was closed or its display comes back."""
        event = self._sdl.SDL_Event()
        while self._sdl.SDL_PollEvent(ctypes.byref(event)):
            if event.type == self._sdl.SDL_WINDOWEVENT:
                self._is_stale = True
                if event.window.event == self._sdl.SDL_WINDOWEVENT_CLOSE:
                    self._close_window()
        self.trouble = self._served()

    def _served(self) -> str:
        """Open and draw what is to be; what is wrong with what is seen then, or nothing."""
        if self._display_size() is None:
            self._close_window()
            return (
                f'no display has its corner at {self._corner[0]}, {self._corner[1]} of the '
                'desktop: plug the projector in, or set display.x and display.y'
            )
        if self._window is None:
            self._open()
        if self._is_stale and self._image is not None:
            self._is_stale, self._drawing = False, self._drawn(self._image)
        shown = self._display_size()
        if shown not in (None, self._size):
            return (
                f'the display shows {shown[0]}x{shown[1]} pixels, the pattern has '
                f"{self._size[0]}x{self._size[1]}: set the display to the projector's resolution "
                'and to a scale of 100 %'
            )
        return self._drawing

    def close(self) -> None:
        """Close the window."""
        self._close_window()
        self._sdl.SDL_Quit()

    def _display_size(self) -> tuple[int, int] | None:
        """Size of the display whose corner is the one given; None if there is none."""
        bounds = self._sdl.SDL_Rect()
        for index in range(self._sdl.SDL_GetNumVideoDisplays()):
            self._sdl.SDL_GetDisplayBounds(index, ctypes.byref(bounds))
            if (bounds.x, bounds.y) == self._corner:
                return bounds.w, bounds.h
        return None

    def _open(self) -> None:
        flags = (
            self._sdl.SDL_WINDOW_BORDERLESS
            | self._sdl.SDL_WINDOW_ALWAYS_ON_TOP
            | self._sdl.SDL_WINDOW_ALLOW_HIGHDPI
        )
        self._is_stale = True
        self._window = self._sdl.SDL_CreateWindow(_TITLE, *self._corner, *self._size, flags)
        if not self._window:
            self._window = None
            raise ConfigurationError(f'the pattern has no window ({self._error()}): check DISPLAY')
        if self._sets_mode:
            self._sdl.SDL_SetWindowFullscreen(self._window, self._sdl.SDL_WINDOW_FULLSCREEN)
        elif self._display_size() == self._size:
            full = self._sdl.SDL_WINDOW_FULLSCREEN_DESKTOP
            self._sdl.SDL_SetWindowFullscreen(self._window, full)
        self._sdl.SDL_ShowCursor(self._sdl.SDL_DISABLE)

    def _drawn(self, image: NDArray[np.uint8]) -> str:
        """Draw; what is wrong with what is seen then, or nothing."""
        sdl, target = self._sdl, self._sdl.SDL_GetWindowSurface(self._window)
        if not target:
            return f'the window cannot be drawn ({self._error()})'
        shown = target.contents
        if shown.format.contents.BitsPerPixel < 24:
            return 'the desktop has fewer than 24 bits a pixel: set it to 24'
        height, width, _ = image.shape
        source = sdl.SDL_CreateRGBSurfaceWithFormatFrom(
            image.ctypes.data, width, height, 24, 3 * width, sdl.SDL_PIXELFORMAT_RGB24
        )
        sdl.SDL_FillRect(target, None, 0)
        sdl.SDL_BlitSurface(source, None, target, None)
        sdl.SDL_FreeSurface(source)
        if sdl.SDL_UpdateWindowSurface(self._window) != 0:
            return f'the window cannot be drawn ({self._error()})'
        if (shown.w, shown.h) != self._size:
            return (
                f'the window of {self._size[0]}x{self._size[1]} has {shown.w}x{shown.h} pixels: '
                'set the scale of the desktop to 100 %'
            )
        return ''

    def _close_window(self) -> None:
        if self._window is not None:
            self._sdl.SDL_DestroyWindow(self._window)
            self._window = None

    def _error(self) -> str:
        return self._sdl.SDL_GetError().decode(errors='replace') or 'SDL gives no reason'


def _load() -> Any:
    """SDL 2's functions; only who shows a window needs them."""
    try:
        return importlib.import_module('sdl2')
    except ImportError as reason:
        raise ConfigurationError(
            f'display.enabled is set, but SDL 2 is not here ({reason}): install python3-sdl2 '
            "(apt), or `pip install 'ftp_dent_ros[display]'`"
        ) from None
