"""From correspondences to a rig: bundle adjustment, its terms, and how well it is known."""
