"""How well a marker does: trials with noise against the bounds, synthetic views, and checks of the results."""
