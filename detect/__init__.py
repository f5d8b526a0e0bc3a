"""From a robot's log to correspondences: wheel samples, stops, tags in images."""
