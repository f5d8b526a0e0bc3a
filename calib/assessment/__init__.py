"""Verdict on a calibration: rules, limits and reasons."""
