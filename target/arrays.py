"""Names of array types that all stages share."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Reals = NDArray[np.floating[Any]]
Index = NDArray[np.intp]
Ids = NDArray[np.int64]
Mask = NDArray[np.bool_]
Image = NDArray[np.uint8]
