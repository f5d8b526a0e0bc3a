"""Many robots, one target: every log calibrated and written, failures kept apart."""
