"""An organised point cloud, and its file."""
