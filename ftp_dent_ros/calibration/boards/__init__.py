"""A printed board: its squares, its corners in photographs, and its print."""
