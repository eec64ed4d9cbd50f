"""From the clouds of flights to one skin with its dents, kept, and compared with earlier ones."""
