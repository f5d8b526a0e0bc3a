"""Difference of one robot's box from that of the others, in words."""

import numpy as np

from boxcal.calib.joint_box.block import Block, at, inverse
from boxcal.calib.joint_box.posterior import Posterior
from boxcal.calib.joint_box.shape_prior import ShapePrior

_WORDS = {
    "tx": "sheet {f} sits {mm:.2f} mm further to the {right}",
    "ty": "sheet {f} sits {mm:.2f} mm {higher}",
    "tz": "sheet {f} sits {mm:.2f} mm further {outward}",
    "rx": "sheet {f} leans by {deg:.2f} deg more",
    "ry": "sheet {f} is turned about the vertical by {deg:.2f} deg more",
    "rz": "sheet {f} is glued askew by {deg:.2f} deg more",
}


def difference(block: Block, others: Posterior, prior: ShapePrior) -> str:
    """Return what differs most between the box of one robot, which is not among the others, and theirs."""
    own = at(block, others.shape)
    # Boxes that were built alike: a robot's own is thought to be as far from the others' as any two boxes are.
    weight, _ = prior.equations(others.shape, others.components)
    cov = inverse(own.information + weight)
    d = cov @ own.score
    gain = np.square(d) / np.maximum(np.diag(inverse(weight)), np.finfo(float).tiny)
    k = int(np.argmax(gain))
    return _said(prior.names[k], float(d[k]))


def _said(name: str, value: float) -> str:
    if name.startswith("scale"):
        return f"it is printed {100 * abs(value):.2f} % {'larger' if value > 0 else 'smaller'}"
    if name.startswith("bow"):
        return f"sheet {name[3:]} bows {1e3 * abs(value):.2f} mm further {'outward' if value > 0 else 'inward'}"
    face, _, axis = name.removeprefix("face").partition("_")
    if axis not in _WORDS:
        return f"its sheets stand {1e3 * abs(value):.2f} mm {'higher' if value > 0 else 'lower'}"
    return _WORDS[axis].format(
        f=face,
        mm=1e3 * abs(value),
        deg=np.degrees(abs(value)),
        right="right" if value > 0 else "left",
        higher="higher" if value > 0 else "lower",
        outward="outward" if value > 0 else "inward",
    )
