"""From photographs of a board under projected patterns to ``rig.yaml``."""
