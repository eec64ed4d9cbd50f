"""What is projected on the board: white, black, Gray codes and phase-shifted fringes.

Gray codes alone, each bit followed by its inverse, in the order of OpenCV's structured_light:
columns, rows, white, black. The project's own: white, black, a few Gray bits and shifted fringes
along both axes, white again. One bit more than the fringes need has its edges amid theirs, so that
a fringe order is never read at an edge (complementary Gray code: Sun and Zhang, 2012).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.fields import Checked, Limits

_LEVELS = 254  # as pattern.py


@dataclass(frozen=True)
class ProjectedFrame:
    """One projected image.

    Attributes
    ----------
    kind : str
        ``white``, ``black``, ``gray``, ``inverse`` or ``shift``.
    axis : str
        ``u``: varies along the columns; ``v``: along the rows; empty for white and black.
    index : int
        Gray: the bit, 0 the coarsest. Shift: the step. White: 0 the first.
    """

    kind: str
    axis: str = ''
    index: int = 0

    @property
    def name(self) -> str:
        """Words for files and sentences."""
        return '_'.join(filter(None, [self.kind, self.axis, f'{self.index}' if self.axis else '']))


@dataclass(frozen=True)
class Sequence(Checked):
    """The images of one pose, in the order in which they are shown.

    Attributes
    ----------
    width, height : int
        Of the projector, pixels.
    period : int
        Of the shifted fringes, projector pixels, a power of two; 0 for Gray codes alone.
    steps : int
        Photographs a period.
    """

    width: Annotated[int, Limits(16, 16384)]
    height: Annotated[int, Limits(16, 16384)]
    period: Annotated[int, Limits(choices=(0, 8, 16, 32, 64, 128))] = 16
    steps: Annotated[int, Limits(3, 64)] = 6

    def size(self, axis: str) -> int:
        """Projector pixels along an axis."""
        return self.width if axis == 'u' else self.height

    def bits(self, axis: str) -> int:
        """Gray bits of an axis."""
        return max(0, math.ceil(math.log2(self.size(axis) / self.cell)))

    @property
    def cell(self) -> int:
        """Width of the finest Gray bit's code word, projector pixels."""
        return max(1, self.period // 2)

    @property
    def frames(self) -> tuple[ProjectedFrame, ...]:
        """What is shown, in order."""
        if not self.period:
            return (
                *(
                    ProjectedFrame(kind, axis, bit)
                    for axis in 'uv'
                    for bit in range(self.bits(axis))
                    for kind in ('gray', 'inverse')
                ),
                ProjectedFrame('white'),
                ProjectedFrame('black'),
            )
        return (
            ProjectedFrame('white'),
            ProjectedFrame('black'),
            *(
                frame
                for axis in 'uv'
                for frame in (
                    *(ProjectedFrame('gray', axis, bit) for bit in range(self.bits(axis))),
                    *(ProjectedFrame('shift', axis, step) for step in range(self.steps)),
                )
            ),
            ProjectedFrame('white', '', 1),
        )

    def draw(self, frame: ProjectedFrame) -> NDArray[np.uint8]:
        """The pixels of one frame, RGB, shape (height, width, 3)."""
        if not frame.axis:
            level = _LEVELS if frame.kind == 'white' else 0
            return np.full((self.height, self.width, 3), level, np.uint8)
        position = np.arange(self.size(frame.axis))
        if frame.kind == 'shift':
            angle = 2 * np.pi * (position / self.period - frame.index / self.steps)
            line = np.rint(_LEVELS * (0.5 + 0.5 * np.cos(angle)))
        else:
            word = position // self.cell
            bit = ((word ^ (word >> 1)) >> (self.bits(frame.axis) - 1 - frame.index)) & 1
            line = _LEVELS * (bit if frame.kind == 'gray' else 1 - bit)
        line = line.astype(np.uint8) if frame.axis == 'u' else line.astype(np.uint8)[:, None]
        return np.repeat(np.broadcast_to(line, (self.height, self.width))[..., None], 3, axis=2)
