"""What is coded: a cloud and its rays."""

from skins import cloud, view  # noqa: F401
