"""The rig: camera and projector, where they are to each other, how well that is known."""
