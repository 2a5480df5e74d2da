"""Anderson acceleration of a fixed-point iteration, at many points at once."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def accelerated(now: Array, step: Array, history: Array) -> Array:
    """The step (n, N) of depth two (or one, or none) from the last states and steps (4, n, N) (Walker and Ni, 2011)."""
    dx, df = now - history[0], step - history[1]
    dx2, df2 = history[0] - history[2], history[1] - history[3]
    deep = np.isfinite(df2[0])
    dx2, df2 = np.where(deep, dx2, 0.0), np.where(deep, df2, 0.0)
    dx, df = np.where(np.isfinite(df), dx, 0.0), np.where(np.isfinite(df), df, 0.0)
    aa, ab, bb = np.sum(df * df, axis=0), np.sum(df * df2, axis=0), np.sum(df2 * df2, axis=0)
    ra, rb = np.sum(df * step, axis=0), np.sum(df2 * step, axis=0)
    determinant = aa * bb - ab * ab
    two = determinant > 1e-8 * aa * bb
    safe = np.where(two, determinant, 1.0)
    first = np.where(two, (ra * bb - rb * ab) / safe, np.where(aa > 0, ra / np.where(aa > 0, aa, 1.0), 0.0))
    second = np.where(two, (rb * aa - ra * ab) / safe, 0.0)
    return np.asarray(step - first * (dx + df) - second * (dx2 + df2))
