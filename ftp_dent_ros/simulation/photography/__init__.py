"""A photograph of the skin in the projector's light, by physics alone."""
