"""Two surveys of one aircraft: the same dents, new ones, gone ones, and their growth."""
