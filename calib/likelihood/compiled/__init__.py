"""Loops over stops and wheel samples compiled by numba: the same arguments and results as their twins in numpy."""
