"""Loops over landmarks compiled by numba: the same arguments and results as their twins in numpy."""
