"""The simulated flight of the whole payload, and what came out of it against the truth."""
