"""The radio between drone and ground: a program between two network namespaces."""
