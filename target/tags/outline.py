"""The outline of a tag: the closed boundaries between its black and white modules."""

import numpy as np
from numpy.typing import NDArray

Corner = tuple[int, int]
Loop = tuple[Corner, ...]


def black_outline(white: NDArray[np.bool_]) -> tuple[Loop, ...]:
    """Return the boundaries of a tag's black part.

    Filled together by the even-odd rule they give the tag as one shape. Modules that are drawn one by one would leave
    hairline seams between them, and each would snap to device pixels on its own.

    Parameters
    ----------
    white : (R, C) bool
        Modules, row 0 at the top; true is white. Outside of it everything counts as white.

    Returns
    -------
    Closed loops of grid corners ``(x, y)`` in modules, x to the right and y **down** from the tag's top-left.
    Only corners where a boundary turns are listed; the first is not repeated at the end. Where modules meet like a
    chessboard's, a loop touches itself or another in that point; no two run along the same line.
    """
    ahead = _directed_edges(np.pad(~white, 1))
    loops = []
    while ahead:
        start = min(ahead, key=lambda corner: (corner[1], corner[0]))
        loop, here, came = [start], start, (0, 0)
        while True:
            step = _right_most(came, ahead[here])
            ahead[here].remove(step)
            if not ahead[here]:
                del ahead[here]
            here, came = (here[0] + step[0], here[1] + step[1]), step
            if here == start:
                break
            loop.append(here)
        loops.append(_turns(loop))
    return tuple(loops)


def _directed_edges(black: NDArray[np.bool_]) -> dict[Corner, list[Corner]]:
    """Return, for each grid corner, the unit steps along the boundary that leave it with black on their right.

    ``black`` is padded by one white module all round; the corners returned count from the unpadded origin.
    """
    ahead: dict[Corner, list[Corner]] = {}
    rows, columns = black.shape
    for row in range(rows):
        for column in range(columns):
            if not black[row, column]:
                continue
            x, y = column - 1, row - 1
            for is_black, corner, step in (
                (black[row - 1, column], (x, y), (1, 0)),
                (black[row, column + 1], (x + 1, y), (0, 1)),
                (black[row + 1, column], (x + 1, y + 1), (-1, 0)),
                (black[row, column - 1], (x, y + 1), (0, -1)),
            ):
                if not is_black:
                    ahead.setdefault(corner, []).append(step)
    return ahead


def _right_most(came: Corner, steps: list[Corner]) -> Corner:
    """Return the step that turns most to the right (y is down), so that loops part where modules touch in a corner."""
    return max(steps, key=lambda step: came[0] * step[1] - came[1] * step[0])


def _turns(loop: list[Corner]) -> Loop:
    """Return the corners of a closed loop at which it changes direction."""
    return tuple(
        here
        for before, here, after in zip(loop[-1:] + loop[:-1], loop, loop[1:] + loop[:1], strict=True)
        if (here[0] - before[0], here[1] - before[1]) != (after[0] - here[0], after[1] - here[1])
    )
