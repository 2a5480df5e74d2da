r"""Measured rows that would tell explanations apart if they were measured again, before anything is simulated for it.

With C the covariance under which an explanation is weighed, r what it leaves of the readings and S their noise, it
expects of a reading without its noise what its model says and :math:`(C - S) C^{-1} r` beside. So two explanations
expect there

.. math:: E_i - E_j = S (C_j^{-1} r_j - C_i^{-1} r_i), \qquad \operatorname{var} = S - S C^{-1} S,

all of which is known. What an explanation's own values leave open is not counted here.
"""

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from models.diagnosis.hypotheses import Fit
from models.diagnosis.refinery import Refinery

Rows = NDArray[np.intp]


def telling_rows(refinery: Refinery, rivals: Sequence[tuple[Fit, float]], among: Rows) -> Rows:
    """Rows of the frame ``among`` these, those first that tell most of fits with their probabilities."""
    o, variance = refinery.observations, refinery.noise**2
    pulled = [refinery.solved(fit) for fit, _ in rivals]
    open_ = np.maximum(variance - variance**2 * refinery.geometry.whitener.diagonal(), 0.0)
    told = np.zeros(o.value.size)
    for (one, (_, p)), (other, (_, q)) in combinations(zip(pulled, rivals, strict=True), 2):
        told += p * q * (variance * (one - other)) ** 2 / (variance + open_)
    worth = np.bincount(o.row, told, minlength=len(o.frame))[among]
    return np.asarray(among[np.argsort(-worth, kind="stable")])
