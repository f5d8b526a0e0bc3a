"""Leave-one-out (jackknife) check of an estimate's sigmas over images and legs."""

from dataclasses import dataclass

import numpy as np

from boxcal.calib.geometry.parameters import ORDER
from boxcal.target.arrays import Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Jackknife:
    """Leave-one-out standard deviations beside the likelihood's.

    Attributes
    ----------
    limit
        Of the ratio, beyond which it is not by chance.
    sigma : (14,)
        In the order and the units of the reported parameters.
    ratio : (14,)
        Over the likelihood's; 1 where it was not tested.
    changes : (C, 14)
        Of the parameters with each image, then each leg left out.
    unexplained
        Whether any is beyond chance: something is not as the model has it.
    """

    limit: float
    sigma: Array
    ratio: Array
    changes: Array
    unexplained: bool

    @property
    def inflation(self) -> Array:
        """Factors on the likelihood's sigmas, (14,): 1 where nothing speaks against them."""
        return np.where(self.ratio > self.limit, self.ratio, 1.0)

    @property
    def worst(self) -> str:
        """Name of the parameter whose sigma is exceeded most."""
        return ORDER[int(np.argmax(self.ratio))]
