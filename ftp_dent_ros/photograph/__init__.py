"""A photograph as a camera takes it, and its files."""
