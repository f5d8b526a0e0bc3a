"""Camera models: pixels from points and points from pixels, with Jacobians."""
