"""The unrolled skin: one picture of it, what was measured of it, and its gaps."""
