"""From an image to a cloud, one stage a module."""
