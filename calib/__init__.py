"""From correspondences to a calibration: the four closed-form steps and what surrounds them."""
