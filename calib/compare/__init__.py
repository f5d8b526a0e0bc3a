"""Comparison of two calibrations, and of a calibration with a simulated robot's truth."""
