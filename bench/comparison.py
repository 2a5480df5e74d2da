"""Two campaigns side by side: what was measured at the same set points in both."""

import math
from dataclasses import dataclass

import numpy as np
import pandas as pd

from bench.store import Store
from bench.wording import counted, points_text
from models.screening import LOADED_KINDS
from models.set_points import set_power

SAME_DUTY = 1e-3  # half periods: set points that differ by less are the same
SAME_POWER_W = 1.0
SIGNIFICANT = 2.0  # standard errors
_LISTED = 3  # entries of a setting that are shown
_NO_SETTINGS = ("resource", "database", "left_out")


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """Rows at common set points: ``P_set_W D1 D2 first second difference u``, efficiencies as fractions.

    ``difference`` is the second campaign's less the first's, ``u`` its standard uncertainty from noise alone (two
    readings' type A and B parts taken as independent); ``names`` are the campaigns', ``virtual`` says whether any of
    them is from a virtual lab, ``settings`` how their settings differ.
    """

    ids: tuple[int, int]
    names: tuple[str, str]
    rows: pd.DataFrame
    counts: tuple[int, int]
    virtual: bool
    settings: tuple[str, ...]

    def lines(self) -> list[str]:
        """The comparison in words."""
        first, second = (f"campaign {id} {name!r}" for id, name in zip(self.ids, self.names, strict=True))
        told = [f"{first}: {self.counts[0]} accepted loaded rows; {second}: {self.counts[1]}"]
        if not len(self.rows):
            return [*told, "they have no set point in common", *self.settings]
        difference = self.rows["difference"].to_numpy(dtype=np.float64)
        mean, count = float(difference.mean()), len(difference)
        error = float(difference.std(ddof=1)) / math.sqrt(count) if count > 1 else math.nan
        about = f" ± {points_text(SIGNIFICANT * error)}" if math.isfinite(error) else ""
        told.append(
            f"{counted(count, 'set point')} in common: efficiency of the second less the first, mean "
            f"{points_text(mean)}{about} points, largest {points_text(float(np.abs(difference).max()))}"
        )
        if math.isfinite(error):
            differ = abs(mean) > SIGNIFICANT * error
            told.append("they differ" if differ else "no difference beyond the scatter of the points")
        return [*told, *self.settings]


def compare(store: Store, first: int, second: int) -> Comparison:
    """Compare two campaigns; StateError when one of them is not there."""
    rows = store.campaign(first), store.campaign(second)
    tables = [_at_set_points(store.measurement_table(id)) for id in (first, second)]
    joined = tables[0].merge(tables[1], on=["key_D1", "key_D2", "key_P"], suffixes=("", "_second"))
    return Comparison(
        ids=(first, second),
        names=(str(rows[0]["name"]), str(rows[1]["name"])),
        rows=pd.DataFrame(
            {
                "P_set_W": joined["P_set_W"],
                "D1": joined["D1"],
                "D2": joined["D2"],
                "first": joined["efficiency"],
                "second": joined["efficiency_second"],
                "difference": joined["efficiency_second"] - joined["efficiency"],
                "u": np.hypot(joined["u_efficiency"], joined["u_efficiency_second"]),
            }
        ).sort_values("P_set_W", ignore_index=True),
        counts=(int(tables[0]["rows"].sum()), int(tables[1]["rows"].sum())),
        virtual=bool(rows[0]["virtual"] or rows[1]["virtual"]),
        settings=_settings(rows[0]["config"], rows[1]["config"]),
    )


def _at_set_points(table: pd.DataFrame) -> pd.DataFrame:
    """Mean efficiency per set point, with the number of rows behind it."""
    names = ["key_D1", "key_D2", "key_P", "P_set_W", "D1", "D2", "efficiency", "u_efficiency", "rows"]
    if not len(table):
        return pd.DataFrame(columns=names, dtype=float)
    loaded = table[table["kind"].isin(LOADED_KINDS)].copy()
    loaded["P_set_W"] = set_power(loaded, loaded["P2_W"])
    if "u_efficiency" not in loaded:
        loaded["u_efficiency"] = np.nan
    for key, name, step in (("D1", "D1", SAME_DUTY), ("D2", "D2", SAME_DUTY), ("P", "P_set_W", SAME_POWER_W)):
        loaded[f"key_{key}"] = (loaded[name] / step).round()
    mean = loaded.groupby(["key_D1", "key_D2", "key_P"], as_index=False)[
        ["P_set_W", "D1", "D2", "efficiency", "u_efficiency"]
    ].mean()
    counts = loaded.groupby(["key_D1", "key_D2", "key_P"], as_index=False).size()
    return mean.assign(rows=counts["size"])[names]


def _settings(first: object, second: object, path: str = "") -> tuple[str, ...]:
    """Settings that differ, dotted; ports, names of files and rows are left out."""
    if isinstance(first, dict) and isinstance(second, dict):
        keys = [key for key in dict.fromkeys([*first, *second]) if key not in _NO_SETTINGS]
        found = (_settings(first.get(k), second.get(k), f"{path}.{k}" if path else str(k)) for k in keys)
        return tuple(line for lines in found for line in lines)
    return () if first == second else (f"{path}: {_setting(first)} and {_setting(second)}",)


def _setting(value: object) -> str:
    """A setting as a person reads it: a list by its length."""
    if value is None:
        return "not set"
    return (
        counted(len(value), "entry", "entries")
        if isinstance(value, list) and len(value) > _LISTED
        else str(value)
    )
