"""What the folder above states in numpy, compiled by numba (extra ``fast``): the same arguments, the same results."""
