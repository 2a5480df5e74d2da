"""Which rows of a measurement table share a set point: by the power that was set, or by powers read that lie near.

Where no set power was noted a load that was set once may wander: powers within a span of one another are then one.
The span is counted from the least of them, so a sweep in small steps is no single set point.
"""

from collections.abc import Sequence

import numpy as np
import pandas as pd

SET_POWER = "P_set_W"


def set_power(measured: pd.DataFrame, read: pd.Series) -> pd.Series:
    """The set power of every row, and what was ``read`` (of the same index) of rows where none was noted."""
    return measured[SET_POWER].fillna(read) if SET_POWER in measured else read


def together(power: pd.Series, keys: Sequence[pd.Series], span: float) -> pd.Series:
    """Of each power the least of those of equal ``keys`` that lie within ``span`` of it, itself the least of its own.

    >>> power = pd.Series([500.3, 499.8, 700.0, 510.0, 505.0])
    >>> together(power, [pd.Series([1, 1, 1, 1, 1])], 6.0).tolist()
    [499.8, 499.8, 700.0, 510.0, 499.8]
    """
    alike = pd.concat(list(keys), axis=1, ignore_index=True).groupby(list(range(len(keys))), dropna=False)
    key, values = alike.ngroup().to_numpy(), power.to_numpy(dtype=float)
    found, last, least = values.copy(), -1, -np.inf
    for place in np.lexsort((values, key)).tolist():
        if key[place] != last or values[place] > least + span:
            last, least = key[place], values[place]
        found[place] = least
    return pd.Series(found, index=power.index)
