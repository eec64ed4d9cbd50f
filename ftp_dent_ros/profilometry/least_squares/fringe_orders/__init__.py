"""Which fringe is which: surfaces told apart, and the order of each."""
