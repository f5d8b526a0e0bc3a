"""Functions of the folder above compiled by numba (extra ``fast``): the same arguments, the same results."""
