"""Functions of the folder above compiled by numba: the same arguments, the same results."""
