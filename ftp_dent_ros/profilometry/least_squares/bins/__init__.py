"""The coarse grids that least squares works on: light in bins, fields at nodes, windows."""
