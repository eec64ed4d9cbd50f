"""One cloud to its dents: the undeformed contour, what departs from it, and its sizes."""
