"""Pages that open offline: one builder, one style, and the pictures in them."""
