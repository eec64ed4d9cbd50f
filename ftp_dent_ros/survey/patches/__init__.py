"""One cloud as a patch of skin: on a regular grid, with its heights and its paint."""
