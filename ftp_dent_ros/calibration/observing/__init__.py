"""From photographs of a board under a sequence to correspondences, a pose at a time."""
