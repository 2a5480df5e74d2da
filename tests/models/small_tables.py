"""Tables of a few rows that can be."""

import pandas as pd


def efficiencies(**columns: object) -> pd.DataFrame:
    """Three rows that can be, with other columns."""
    good = {"D1": [0.9, 0.8, 0.7], "D2": 0.1, "P2_W": [500.0, 600.0, 700.0], "efficiency": [0.97, 0.96, 0.95]}
    return pd.DataFrame({**good, **columns})
