"""Numerics of what a fleet's calibrations say over time: scatter between drives, wear, changes beyond chance."""
