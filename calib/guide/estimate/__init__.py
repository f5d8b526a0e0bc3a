"""The calibration so far: after each stop at once, and in full in the background."""
