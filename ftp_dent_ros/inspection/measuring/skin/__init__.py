"""The skin as it should be: panels, each with its undeformed contour, its waves and its noise."""
