"""Automatic retraining: new measurements → candidate → judged on blocks that nobody saw → promoted or kept out.

A candidate of each kind (D²EA; the simulator itself with trees for the gap; calibrated physics, which a diagnosis of
the rows makes of the simulator) is fitted to the accepted rows outside
the held-out blocks (:mod:`models.held_blocks`). Those inside judge: the best candidate against the model in use and
the simulation itself, on rows that the model in use was not fitted to either. It is promoted when its mean absolute
error is not larger than theirs; what was judged is what is used, no refit follows. A candidate that predicts none of
those rows is left out. A model in use that this version cannot read is no rival: nothing can predict with it. Either
way the decision and its reason go into the journal.

Nothing here touches a bench: it reads the database beside a campaign, which never waits for it.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import pandas as pd

from bench.lut_file import LutOrigin, write_beside
from bench.model_file import simulator_for
from bench.optimum import BestModulation, loads_of
from bench.store import Store
from bench.training import HALF_WIDTH, HELD_OUT, NotTrained, Say, Trainer, efficiency_of, simulated_table
from bench.training_data import Places, TrainingData, same_bench
from bench.wording import join, points_text
from models.accuracy import accuracy_of, half_width
from models.boosting import Floats
from models.calibrated import vouched
from models.feasibility import Bools
from models.held_blocks import held_out
from models.journal import Choice, Decision, Journal
from models.lut import Lut
from models.registry import ModelRecord, Origin, Registry, RegistryError, data_hash
from models.surrogate import (
    CALIBRATED,
    D2EA,
    SIMULATOR_FIRST,
    EfficiencyModel,
    SimulatorStage,
    StagedModel,
    inputs_of,
)
from sim.model import Model

KINDS = (D2EA, SIMULATOR_FIRST, CALIBRATED)
LEAST_FITTED = 20  # rows; fewer say little about anything
LEAST_JUDGED = 5  # rows that neither model saw
SIMULATION = "simulation"
CANDIDATE = "candidate"


@dataclass(frozen=True, slots=True, kw_only=True)
class Retraining:
    """What one look at the data came to; without a decision, ``said`` tells what is missing."""

    said: str
    decision: Decision | None = None
    lut: Lut | None = None
    files: tuple[Path, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Retrainer:
    """Retrains the models of one registry, against one simulator."""

    registry: Registry
    simulator: Model
    now: Callable[[], str]
    kinds: tuple[str, ...] = KINDS  # of candidates; the best of them is judged against its rivals
    shape: tuple[int, int, int] = (25, 25, 20)  # of the simulated grid: D1, D2, power
    loads_W: tuple[float, ...] | None = None  # of the table; else the converter's
    say: Say = lambda said: None  # what it is at

    @property
    def journal(self) -> Journal:
        """The decisions about this registry's models."""
        return Journal(self.registry.root)

    @cached_property
    def simulated(self) -> pd.DataFrame:
        """The feasible points of the grid; simulated once."""
        return simulated_table(self.simulator, self.shape)

    @cached_property
    def search(self) -> BestModulation:
        """The search over load; it asks the simulator once what each load can be carried with."""
        return BestModulation(simulator=self.simulator, loads_W=self.loads_W or loads_of(self.simulator))

    def retrain(self, data: TrainingData) -> Retraining:
        """Train, judge and decide; the table of a promoted model is written beside it.

        Raises BenchError where the model in use is of another converter.
        """
        if not len(data):
            return Retraining(said="waiting: no accepted rows yet")
        rivals, unread = self._rivals()
        held = held_out(data.rows, self.simulator.converter.rated_power_W)
        unseen = self._unseen(data, held)
        sha = data_hash(data.table, self.simulated)
        decided = not unread and any(entry.data_sha256 == sha for entry in self.journal.decisions())
        if said := self._not_yet(int((~held).sum()), int(unseen.sum()), decided):
            return Retraining(said=said)
        judged = data.rows[unseen]
        candidates, missing = self._candidates(data, np.flatnonzero(~held))
        candidates, blind = comparable(candidates, rivals, judged)
        missing += blind
        if not candidates:
            return Retraining(said=f"waiting: {'; '.join(missing)}")
        candidate, errors, others = self._best(candidates, rivals, judged)
        record = self._keep(
            candidate, data, held, sha=sha, metrics=_metrics(candidate, judged, errors[CANDIDATE])
        )
        decision = self._decide(record, errors, len(judged), aside=(*others, *missing, *unread))
        if decision.decision is not Choice.PROMOTED:
            return Retraining(said=said_of(decision), decision=self.journal.note(decision))
        self.say(f"the best modulation of the {candidate.kind} model over load")
        searched = vouched(candidate)
        lut = self.search.table(searched, self.search.exactly(searched), record.metrics[HALF_WIDTH])
        files = write_beside(self.registry.root / record.id, lut, LutOrigin.of(record, self.simulator))
        noted = self.journal.note(decision)  # last: a model in use always has its table
        return Retraining(said=said_of(noted), decision=noted, lut=lut, files=files)

    def _not_yet(self, fitted: int, unseen: int, decided: bool) -> str:
        """Why nothing can be decided now; empty when it can."""
        if fitted < LEAST_FITTED or unseen < LEAST_JUDGED:
            needed = f"{LEAST_FITTED} and {LEAST_JUDGED} are needed"
            return f"waiting: {fitted} rows to fit and {unseen} that no model saw; {needed}"
        if decided:
            return f"nothing new since the last decision: {fitted} rows to fit, {unseen} to judge on"
        return ""

    def _keep(
        self, candidate: StagedModel, data: TrainingData, held: Bools, *, sha: str, metrics: dict[str, float]
    ) -> ModelRecord:
        names = np.array(data.names)
        fitted, held_names = (tuple(names[rows].tolist()) for rows in (~held, held))
        origin = Origin(
            data=data.data, virtual=data.virtual, fitted=fitted, held_out=held_names,
            simulator=self.simulator.as_plain(),
        )  # fmt: skip
        return self.registry.save(
            candidate, data_sha256=sha, created=self.now(), metrics=metrics, origin=origin
        )

    def _unseen(self, data: TrainingData, held: Bools) -> Bools:
        """Rows in held-out blocks that the model in use was not fitted to, (N,) of bool."""
        used = self.journal.in_use()
        seen = frozenset(self.registry.origin(used).fitted) if used else frozenset()
        return np.asarray(held & np.array([name not in seen for name in data.names]))

    def _candidates(self, data: TrainingData, fitted: Places) -> tuple[dict[str, StagedModel], list[str]]:
        """One of each kind, fitted to the same rows; of which kinds there is none, and why."""
        trainer = Trainer(simulator=self.simulator, simulated=self.simulated, say=self.say)
        candidates, missing = dict[str, StagedModel](), list[str]()
        for kind in self.kinds:
            self.say(f"training {kind} on {len(fitted)} rows")
            try:
                candidates[kind] = trainer.fit(kind, data, fitted)
            except NotTrained as why:
                missing.append(str(why))
        return candidates, missing

    def _best(
        self,
        candidates: Mapping[str, StagedModel],
        rivals: Mapping[str, EfficiencyModel],
        judged: pd.DataFrame,
    ) -> tuple[StagedModel, dict[str, float], list[str]]:
        """The candidate of the smallest error, the errors of it and its rivals, and in words those of the others."""
        errors = errors_on(judged, {**candidates, **rivals})
        best, *others = sorted(candidates, key=lambda kind: errors[kind])
        told = [f"{kind} {points_text(errors[kind])}" for kind in others]
        return candidates[best], {CANDIDATE: errors[best]} | {name: errors[name] for name in rivals}, told

    def _rivals(self) -> tuple[dict[str, EfficiencyModel], tuple[str, ...]]:
        """The simulation itself, and the model in use where there is one; or in words that it cannot be read.

        Raises BenchError where it is of another converter.
        """
        efficiency = efficiency_of(self.simulator)
        rivals: dict[str, EfficiencyModel] = {SIMULATION: SimulatorStage(efficiency)}
        used = self.journal.in_use()
        if used is None:
            return rivals, ()
        record = self.registry.show(used)
        simulator_for(record, self.simulator)
        own = record.made_beside()
        try:
            rivals[used] = self.registry.load(used, efficiency_of(own) if own else efficiency)
        except RegistryError as error:
            self.say(f"model {used} is in use and cannot be compared: {error}")
            return rivals, (f"model {used}, in use until now, is not compared: this version cannot read it",)
        return rivals, ()

    def _decide(
        self, record: ModelRecord, errors: Mapping[str, float], judged: int, *, aside: Sequence[str] = ()
    ) -> Decision:
        """Promote a kept candidate or not; ``aside`` is what else there is to say of this round."""
        used = self.journal.in_use()
        promoted, reason = self._verdict(record.id, errors, judged)
        return Decision(
            when=self.now(),
            decision=Choice.PROMOTED if promoted else Choice.KEPT_OUT,
            model=record.id,
            reason="; ".join([f"{record.kind}, {reason}", *aside]),
            replaced=used if promoted else None,
            data_sha256=record.data_sha256,
            errors={record.id if name == CANDIDATE else name: error for name, error in errors.items()},
        )

    def _verdict(self, model: str, errors: Mapping[str, float], judged: int) -> tuple[bool, str]:
        """Whether the candidate is no worse than its rivals, and the reason in words."""
        own = errors[CANDIDATE]
        rivals = {name: rival_name(name) for name in errors if name != CANDIDATE}
        told = f"{points_text(own)} points on {judged} unseen rows"
        against = " and ".join(f"{said} {points_text(errors[name])}" for name, said in rivals.items())
        if model in self.journal.rolled_back():
            return False, f"{told}, but a person took this very model back"
        if worse_than := [said for name, said in rivals.items() if errors[name] < own]:
            return False, f"{told}; {against}: worse than {' and '.join(worse_than)}"
        return True, f"{told}; {against}"


def _metrics(candidate: StagedModel, judged: pd.DataFrame, error: float) -> dict[str, float]:
    width = half_width(candidate.predict(*inputs_of(judged)), truth_of(judged))
    return {HELD_OUT: error, HALF_WIDTH: width}


def comparable(
    candidates: Mapping[str, StagedModel], rivals: Mapping[str, EfficiencyModel], judged: pd.DataFrame
) -> tuple[dict[str, StagedModel], list[str]]:
    """Candidates that predict some rows which their rivals, and each other, predict too; why the others cannot be
    judged."""
    known = np.all([_predicted(model, judged) for model in rivals.values()], axis=0)
    if not known.any():
        return {}, [
            f"none of the {len(judged)} unseen rows is predicted by {join([*map(rival_name, rivals)])}"
        ]
    kept, blind = dict[str, StagedModel](), list[str]()
    for kind, model in candidates.items():
        shared = known & _predicted(model, judged)
        if shared.any():
            kept[kind], known = model, shared
        else:
            blind.append(f"{kind} predicts none of the {known.sum()} unseen rows to judge on")
    return kept, blind


def _predicted(model: EfficiencyModel, measured: pd.DataFrame) -> Bools:
    return np.isfinite(model.predict(*inputs_of(measured)))


def rival_name(name: str) -> str:
    """What a candidate is compared with, in words."""
    return "the simulation" if name == SIMULATION else f"model {name}"


def errors_on(measured: pd.DataFrame, models: Mapping[str, EfficiencyModel]) -> dict[str, float]:
    """Mean absolute error of each model on the rows that all of them can predict.

    Raises ValueError when there is no such row.
    """
    predicted = {name: model.predict(*inputs_of(measured)) for name, model in models.items()}
    known = np.all([np.isfinite(values) for values in predicted.values()], axis=0)
    truth = truth_of(measured)
    return {name: accuracy_of(values[known], truth[known]).mean_abs for name, values in predicted.items()}


def truth_of(measured: pd.DataFrame) -> Floats:
    """Measured efficiency (N,)."""
    return measured["efficiency"].to_numpy(dtype=np.float64)


def said_of(decision: Decision) -> str:
    """A decision in words."""
    return f"model {decision.model} {decision.decision.replace('_', ' ')}: {decision.reason}"


# --- the data of the newest campaign ------------------------------------------------------------------


def newest_data(store: Store, campaign_id: int | None = None) -> TrainingData | None:
    """Accepted rows of a campaign, by default the newest, and of the ones before it on its bench."""
    ids = [row["id"] for row in store.campaigns()]
    if campaign_id is not None:
        store.campaign(campaign_id)
    elif not ids:
        return None
    return TrainingData.of_campaigns(store, same_bench(store, campaign_id or max(ids)))


def note_in_store(store: Store, data: TrainingData, retraining: Retraining) -> None:
    """The decision beside the campaign that led to it."""
    if (decision := retraining.decision) is None or not data.campaigns:
        return
    detail = {"decision": str(decision.decision), "reason": decision.reason, "errors": dict(decision.errors)}
    store.add_model(decision.model, detail, campaign_id=data.campaigns[-1])


def watch(
    store: Store, retrainer: Retrainer, *, every: int, wait: Callable[[], bool]
) -> Iterator[tuple[TrainingData, Retraining]]:
    """Retrain after every ``every`` more accepted rows and once a campaign has ended, until ``wait`` is false.

    Rows that a person rejected, or the campaign, are not counted and not learnt from.
    """
    learnt: dict[tuple[int, ...], int] = {}
    going = True
    while going:
        ids, accepted, live = _accepted(store)
        new = accepted - learnt.get(ids, 0)
        if new >= every or (new > 0 and not live):
            data = TrainingData.of_campaigns(store, ids)
            learnt[ids] = accepted
            yield data, retrainer.retrain(data)
        going = wait()


def _accepted(store: Store) -> tuple[tuple[int, ...], int, bool]:
    """The campaigns on the bench of the newest one, their accepted rows, and whether one of them runs now."""
    rows = {row["id"]: row for row in store.campaigns()}
    if not rows:
        return (), 0, False
    ids = same_bench(store, max(rows))
    return ids, sum(rows[id]["accepted"] for id in ids), any(rows[id]["is_live"] for id in ids)
