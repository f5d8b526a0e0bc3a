"""The calibration of one robot: what is saved and loaded, and what is derived from it."""
