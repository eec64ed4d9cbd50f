"""The payload's data on the ground: what crosses a thin link, in which form and which order."""
