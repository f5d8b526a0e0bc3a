"""Small positive definite systems by Cholesky's decomposition."""

from typing import Any

import numpy as np

from boxcal.detect.alignment.numba.kernel import loops


@loops()
def factor(A: Any) -> None:
    """Replace the lower triangle of A (n, n) by that of its factor L, ``A = L L^T``."""
    for i in range(len(A)):
        for j in range(i + 1):
            total = A[i, j]
            for m in range(j):
                total -= A[i, m] * A[j, m]
            if i == j:
                A[i, i] = np.sqrt(max(total, 1e-300))
            else:
                A[i, j] = total / A[j, j]


@loops()
def solve_lower(L: Any, b: Any, x: Any) -> None:
    """Fill x (n,) with the solution of ``L x = b``."""
    for i in range(len(L)):
        total = b[i]
        for m in range(i):
            total -= L[i, m] * x[m]
        x[i] = total / L[i, i]


@loops(fastmath={"contract"})
def solve_lower_rows(L: Any, X: Any) -> None:
    """Replace the columns of X (n, m) by the solutions of ``L x = b``: row by row, as vector instructions."""
    for i in range(len(L)):
        row, by_diagonal = X[i], 1 / L[i, i]
        for m in range(i):
            before, by = X[m], L[i, m]
            for k in range(len(row)):
                row[k] -= by * before[k]
        for k in range(len(row)):
            row[k] *= by_diagonal


@loops()
def solve_factored(L: Any, b: Any, x: Any) -> None:
    """Fill x (n,) with the solution of ``L L^T x = b``."""
    solve_lower(L, b, x)
    for i in range(len(L) - 1, -1, -1):
        total = x[i]
        for m in range(i + 1, len(L)):
            total -= L[m, i] * x[m]
        x[i] = total / L[i, i]


@loops()
def solve_positive(A: Any, b: Any, x: Any) -> None:
    """Fill x (n,) with the solution of ``A x = b``; A is overwritten by its factor."""
    factor(A)
    solve_factored(A, b, x)
