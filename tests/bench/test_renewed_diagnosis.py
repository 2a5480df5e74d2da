"""The diagnosis that is renewed beside a retrained model: of what it is, what it leaves out, and what ends nothing."""

from pathlib import Path

import pytest

from bench.commands.retrain import _settle
from bench.imported import import_config
from bench.retrain import Retraining, newest_data
from bench.store import Provenance
from experiments.onset_trials import happened
from models.dataset import Measurements
from models.journal import Choice, Decision
from models.screening import RejectedRow
from sim.model import Model
from tests.bench.fake_bench import memory
from tests.bench.readings import imported, measured
from tests.models.diagnosis.virtual_campaign import lab_table

DECIDED = Retraining(
    said="model 0 kept out",
    decision=Decision(when="2024-05-01T12:00:00+00:00", decision=Choice.KEPT_OUT, model="0", reason="worse"),
)


def test_too_few_rows_for_a_diagnosis_are_said_and_end_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    with memory() as store:
        campaign = imported(store, measured(8))
        data = newest_data(store)
        assert data is not None
        _settle(store, data, DECIDED, Model.baseline())
        assert store.diagnoses(campaign) == []
    said = " ".join(capsys.readouterr().out.split())
    assert (
        f"no diagnosis of campaign 1: {len(measured(8))} usable rows that carry power; a diagnosis needs"
        in said
    )


def test_a_renewed_diagnosis_says_of_what_it_is() -> None:
    lost = RejectedRow(row=7, column="P1_W", value="", reason="no number")
    config = import_config(
        Path("theirs.csv"), Measurements(frame=measured(1), rows=(1,), rejected=(lost,), notes=())
    )
    with memory() as store:
        store.import_table("theirs", measured(40), Provenance(config=config, config_hash="0", virtual=True))
        data = newest_data(store)
        assert data is not None
        _settle(store, data, DECIDED, Model.baseline())
        answer = store.diagnoses(1)[0]["verdict"]
    assert answer["campaign"]["accepted"] == len(measured(40))
    assert answer["left_out_by_import"]["rows"][0]["row"] == 7
    assert "V1_V is not in the table: taken as 300 V" in answer["notes"]


def test_a_renewed_diagnosis_says_what_both_stretches_of_a_change_say() -> None:
    changed, _ = happened(lab_table({}, seed=171), lab_table({"link_resistance": 0.08}, seed=171), 0.5)
    with memory() as store:
        imported(store, changed)
        data = newest_data(store)
        assert data is not None
        _settle(store, data, DECIDED, Model.baseline())
        answer = store.diagnoses(1)[0]["verdict"]
    before, after = answer["unknown"]["onset"]["stretches"]
    assert (before["answer"]["verdict"], after["answer"]["named"]) == ("consistent", ["link_resistance"])
