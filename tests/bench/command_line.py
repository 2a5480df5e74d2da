"""The command line as a person calls it, and files as a person gives them to it."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from bench import cli
from bench.toml_file import to_toml
from tests.bench.fake_bench import BENCH, CAMPAIGN


def d2ea(*arguments: str) -> int:
    """Run one command; its exit code."""
    with pytest.raises(SystemExit) as ended:
        cli.main(arguments)
    return int(ended.value.code or 0)


def bench_file(**changes: object) -> str:
    """The fake bench with some tables changed, as a file here; its name."""
    Path("bench.toml").write_text(to_toml({**BENCH, **changes}))
    return "bench.toml"


def campaign_file(**changes: object) -> str:
    """The six-point campaign with some tables changed, as a file here; its name."""
    Path("campaign.toml").write_text(to_toml({**CAMPAIGN, **changes}))
    return "campaign.toml"


def measured_table(rows: int = 60) -> str:
    """A table as other people measure one, near what is simulated, as a file here; its name."""
    rng = np.random.default_rng(1)
    D1, D2, P2_W = rng.uniform(0.6, 0.9, rows), rng.uniform(0.05, 0.3, rows), rng.uniform(300, 1200, rows)
    efficiency = 0.97 + 0.01 * D1 - 0.01 * D2
    pd.DataFrame({"D1": D1, "D2": D2, "P2_W": P2_W, "P1_W": P2_W / efficiency}).to_csv(
        "theirs.csv", index=False
    )
    return "theirs.csv"
