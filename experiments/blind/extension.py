"""What an extension is worth where nothing was measured: a whole band of power is kept from the diagnosis.

Beside the extended model, the true effect is fitted to the same rows by least squares of the input power. Both
are compared with what the lab's analyzer would show without noise in the band that was kept.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from drivers.mocks.lab.laboratory import DRIFT_S
from drivers.mocks.lab.survey import settle, survey
from experiments.blind.draws import extension
from experiments.blind.part import Outcome, Part, Run
from experiments.blind.trial import BlindTrial, laboratory
from experiments.harness.result import POINTS, Goal, Table
from models.dataset import load_measurements
from models.diagnosis.diagnose import diagnose
from models.screening import LOADED_KINDS
from sim.effects.catalogue import CATALOGUE
from sim.model import Model
from sim.operating_points import Points
from sim.simulate import Result, reference, simulate_many

Array = NDArray[np.float64]

EXTENSIONS, BAR = 200, 1.2
_BANDS, _RESAMPLES = 4, 2000
_BESIDE = {"warm_up_drift": {"time_constant_s": DRIFT_S}}  # the other labs' are where the effects are off


def points_of(rows: pd.DataFrame) -> Points:
    """Set points as applied and measured."""
    return Points(
        D1=rows["D1"].to_numpy(), D2=rows["D2"].to_numpy(), power_W=rows["P2_W"].to_numpy(),
        V1_V=rows["V1_V"].to_numpy(), V2_V=rows["V2_V"].to_numpy(),
        ambient_C=rows["T_ambient_C"].to_numpy(), time_s=rows["time_s"].to_numpy(),
    )  # fmt: skip


def kept_band(loaded: pd.DataFrame, seed: int) -> NDArray[np.bool_]:
    """One of four bands of power, by the seed."""
    edges = np.quantile(loaded["P2_W"], np.linspace(0, 1, _BANDS + 1))
    k = seed % _BANDS
    power = loaded["P2_W"].to_numpy()
    return np.asarray((power >= edges[k]) & (power <= edges[k + 1]))


def true_model(name: str, near: Result, shown_W: Array, fitted: NDArray[np.bool_]) -> Model:
    """The baseline with the effect that is there, fitted to some rows of those that a simulation ``near`` it has.

    What is beside its headline is as the lab has it.
    """
    head, beside = CATALOGUE[name].headline, _BESIDE.get(name, {})

    def model(value: float) -> Model:
        return Model.baseline().with_effect(name, **{head.name: value}, **beside)

    def misfit(value: float) -> float:
        (there,) = simulate_many([model(value)], near.points, near)
        left = (there["P1_W"] - shown_W)[fitted]
        return float(np.nansum(left**2))

    reach = 5 * head.prior
    bounds = (max(head.lower, head.off - reach), min(head.upper, head.off + reach))
    found = minimize_scalar(
        misfit, bounds=bounds, method="bounded", options={"xatol": 1e-3 * head.prior, "maxiter": 25}
    )
    return model(float(found.x))


def ask_extended(trial: BlindTrial) -> dict[str, Any]:
    """Diagnose without the band, and judge every model in it; errors are mean, absolute, of efficiency."""
    lab = laboratory(trial)
    settled = settle(lab, trial.plan)
    table = survey(lab, trial.plan, seed=trial.seed, settled=settled)
    truth = survey(lab.without_noise(), trial.plan, seed=trial.seed, settled=settled)
    rows = table["kind"].isin(LOADED_KINDS).to_numpy()
    kept = np.zeros(len(table), dtype=bool)
    kept[rows] = kept_band(table[rows], trial.seed)
    points, shown_W = points_of(table[rows]), table.loc[rows, "P1_W"].to_numpy()
    diagnosis = diagnose(load_measurements(table[~kept]))
    name, near = trial.names[0], reference(Model.baseline(), points)
    models = {
        "baseline": Model.baseline(),
        "extended": diagnosis.extended,
        "true": true_model(name, near, shown_W, ~kept[rows]),
    }
    wanted = truth.loc[rows, "efficiency"].to_numpy()[kept[rows]]
    found = simulate_many(list(models.values()), points, near)
    simulated = {key: there["efficiency"][kept[rows]] for key, there in zip(models, found, strict=True)}
    known = np.all(np.isfinite(list(simulated.values())), axis=0)
    errors = {key: float(np.mean(np.abs(eta - wanted)[known])) for key, eta in simulated.items()}
    return {
        "errors": errors,
        "verdict": diagnosis.verdict.kind,
        "extended": list(diagnosis.extended.effects),
    }


def ratio(errors: Sequence[dict[str, float]]) -> tuple[float, tuple[float, float]]:
    """Mean error extended over mean error of the true effect, with its 95 % interval by paired resampling."""
    table = np.array([[e["extended"], e["true"]] for e in errors])
    picks = np.random.default_rng(0).integers(0, len(table), (_RESAMPLES, len(table)))
    means = table[picks].mean(axis=1)
    low, high = np.quantile(means[:, 0] / means[:, 1], [0.025, 0.975])
    whole = table.mean(axis=0)
    return float(whole[0] / whole[1]), (float(low), float(high))


def _extension(run: Run) -> Outcome:
    done = run.records(extension, EXTENSIONS, ask_extended)
    value, ci95 = ratio([r["errors"] for _, r in done])
    goal = Goal(
        name=f"extension: held-out error against the true effect's ({len(done)} trials)",
        value=value, bar=BAR, at_least=False, ci95=ci95,
    )  # fmt: skip
    rows = []
    for name in dict.fromkeys(t.names[0] for t, _ in done):
        own = [r for t, r in done if t.names[0] == name]
        mean = {k: POINTS * float(np.mean([r["errors"][k] for r in own])) for k in own[0]["errors"]}
        right = sum(name in r["extended"] for r in own)
        rows.append((name, len(own), mean["baseline"], mean["extended"], mean["true"], right))
    columns = ("hidden", "trials", "baseline, points", "extended", "true effect fitted", "extended by it")
    table = Table(title="Error in a band of power that was kept out", columns=columns, rows=tuple(rows))
    return Outcome(goals=(goal,), tables=(table,))


EXTENSION_PART = Part(name="extension", says="error after extension on a band kept out", run=_extension)
