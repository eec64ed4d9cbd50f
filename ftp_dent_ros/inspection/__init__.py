"""From a cloud to its dents."""
