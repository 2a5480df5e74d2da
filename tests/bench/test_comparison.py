"""Two campaigns at the set points that both measured."""

import pandas as pd
import pytest

from bench.comparison import compare
from bench.errors import StateError
from bench.store import Provenance, Store

SET_POINTS = {"D1": [0.8, 0.9, 0.7], "D2": [0.1, 0.0, 0.2], "P_set_W": [500.0, 800.0, 300.0]}


def campaign(store: Store, efficiency: list[float], rows: slice = slice(None), **settings: object) -> int:
    table = pd.DataFrame(SET_POINTS).assign(efficiency=efficiency, kind="load", u_efficiency=1e-4)
    table["P2_W"] = table["P_set_W"] * 1.001
    table["P1_W"] = table["P2_W"] / table["efficiency"]
    provenance = Provenance(config={"campaign": settings}, config_hash="0", virtual=True)
    return store.import_table("map", table.iloc[rows], provenance)


def test_the_difference_is_second_less_first_where_both_measured(store: Store) -> None:
    first = campaign(store, [0.97, 0.98, 0.96])
    second = campaign(store, [0.975, 0.985, 0.9], slice(0, 2))
    found = compare(store, first, second)
    assert found.rows["difference"].round(9).tolist() == [0.005, 0.005]
    assert found.counts == (3, 2)
    assert "2 set points in common" in found.lines()[1]
    assert found.lines()[2] == "they differ"


def test_scatter_is_no_difference(store: Store) -> None:
    found = compare(store, campaign(store, [0.97, 0.98, 0.96]), campaign(store, [0.971, 0.979, 0.9601]))
    assert "no difference beyond the scatter" in " ".join(found.lines())


def test_settings_that_differ_are_named(store: Store) -> None:
    efficiency = [0.97, 0.98, 0.96]
    found = compare(store, campaign(store, efficiency, seed=1), campaign(store, efficiency, seed=2))
    assert found.lines()[-1] == "campaign.seed: 1 and 2"


def test_a_long_setting_is_told_by_its_length(store: Store) -> None:
    efficiency = [0.97, 0.98, 0.96]
    first, second = campaign(store, efficiency, points=None), campaign(store, efficiency, points=[1, 2, 3, 4])
    assert compare(store, first, second).lines()[-1] == "campaign.points: not set and 4 entries"


def test_nothing_in_common_and_nothing_there_are_said(store: Store) -> None:
    first = campaign(store, [0.97, 0.98, 0.96], slice(0, 1))
    second = campaign(store, [0.97, 0.98, 0.96], slice(1, 2))
    assert "no set point in common" in " ".join(compare(store, first, second).lines())
    with pytest.raises(StateError, match="there is no campaign 9"):
        compare(store, first, 9)
