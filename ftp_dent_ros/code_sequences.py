"""Sequences of high and low contrast in which every few fringes tell which they are.

Each is a shift register's: eight bits tell the next one. That of a register whose polynomial has
no two zeros side by side has words of ten bits that differ in two places.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

# Registers: the bits that are added up for the next one, the oldest first; 1 if one more is added;
# and the first word. Of all first words, each is one after which, over 160 bits, words of 16
# differ in 3 places and none of 15 is found mirrored. By search over all registers of 8 bits.
_REGISTERS = (
    (0b11111010, 0, 0b00011100),
    (0b11101010, 1, 0b00000000),
    (0b10111010, 1, 0b11111110),
    (0b11111010, 1, 0b00000000),
    (0b10101110, 1, 0b00000000),
    (0b11111110, 1, 0b00000000),
    (0b11110101, 0, 0b10100010),
    (0b11110101, 1, 0b01011101),
    (0b11111101, 1, 0b00000000),
    (0b10101011, 1, 0b00000000),
    (0b11111011, 1, 0b00000000),
    (0b11010111, 0, 0b10000000),
    (0b11010111, 1, 0b00000000),
    (0b10101111, 0, 0b10000000),
    (0b10101111, 1, 0b10001101),
    (0b11101111, 1, 0b00000000),
)
# Bits of a sequence. From 186 on some begin again.
_LENGTH = 256


def _sequence(added: int, one_more: int, first: int) -> NDArray[np.bool_]:
    """Bits of a shift register."""
    bits = [first >> place & 1 for place in range(7, -1, -1)]
    taps = [place for place in range(8) if added >> (7 - place) & 1]
    while len(bits) < _LENGTH:
        oldest = len(bits) - 8
        bits.append((sum(bits[oldest + tap] for tap in taps) + one_more) % 2)
    return np.array(bits, bool)


#: All sequences, shape (16, 256).
SEQUENCES = np.stack([_sequence(*register) for register in _REGISTERS])
