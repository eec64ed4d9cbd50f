"""The page on the ground: what comes, in a browser or in Foxglove, and the commands."""
