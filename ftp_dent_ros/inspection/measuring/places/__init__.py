"""Where the skin departs from its contour, how surely, and as what."""
