"""The projected pattern: what it is, its file, how it is read back from an image."""
