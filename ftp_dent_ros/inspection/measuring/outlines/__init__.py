"""A dent on its patch: its bottom, its outline, what was smoothed away of it."""
