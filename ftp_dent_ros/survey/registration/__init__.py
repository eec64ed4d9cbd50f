"""Two overlapping patches to their relative pose, and how well it is known."""
