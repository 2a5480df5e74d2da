"""A campaign ready to run: its settings, its bench, its plan, and who predicts."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from bench.adaptive import Chooses, chooser
from bench.config import BenchConfig, CampaignConfig, check, config_hash
from bench.errors import StateError
from bench.plan import Kind, Plan, PlannedPoint, make_plan
from bench.prediction import Predictor, SimulatedConverter
from bench.safety import PowerOffReport
from bench.store import Provenance, Row, Store


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """A campaign, the bench it runs on, its plan, who predicts, and who chooses more points where the plan grows."""

    campaign: CampaignConfig
    bench: BenchConfig
    plan: Plan
    predict: Predictor
    choose: Chooses | None = None

    @classmethod
    def prepare(
        cls,
        campaign: CampaignConfig,
        bench: BenchConfig,
        *,
        predict: Predictor | None = None,
        file: str = "campaign.toml",
        bench_file: str = "",
    ) -> "Job":
        """Plan the campaign; InputError names ``file``, or ``bench_file``, and what is wrong with its points."""
        predict = predict or SimulatedConverter.of(bench.converter)
        return cls(
            campaign=campaign,
            bench=bench,
            plan=make_plan(campaign, bench, predict, file=file, bench_file=bench_file),
            predict=predict,
            choose=chooser(campaign, bench, predict, file=file),
        )

    @classmethod
    def stored(
        cls, store: Store, row: Row, *, bench: BenchConfig | None = None, predict: Predictor | None = None
    ) -> "Job":
        """The job of a campaign in the ledger, with the plan that it was given then.

        ``bench`` takes the place of the stored settings: instruments may have moved to other ports.
        """
        config = row["config"]
        if "campaign" not in config:
            raise StateError(f"campaign {row['id']} was imported: there is nothing to run")
        settings = bench or check(config["bench"], BenchConfig, file=f"bench of campaign {row['id']}")
        if settings.name != row["bench"]:
            raise StateError(
                f"campaign {row['id']} belongs to the bench {row['bench']!r}, not {settings.name!r}"
            )
        points = tuple(planned(point) for point in store.predictions(row["id"]).to_dict(orient="records"))
        file, predict = f"campaign {row['id']}", predict or SimulatedConverter.of(settings.converter)
        campaign = check(config["campaign"], CampaignConfig, file=file)
        most = campaign.plan.points if campaign.plan.adaptive else None
        return cls(
            campaign=campaign,
            bench=settings,
            plan=Plan(points=points, tried=len(points), infeasible={}, most=most),
            predict=predict,
            choose=chooser(campaign, settings, predict, file=file),
        )

    def provenance(self, key: str | None = None) -> Provenance:
        """What the ledger keeps of it."""
        settings = {
            "campaign": self.campaign.model_dump(mode="json"),
            "bench": self.bench.settings(),
        }
        return Provenance(
            config=settings,
            config_hash=config_hash(self.campaign, self.bench),
            virtual=self.bench.virtual,
            bench=self.bench.name,
            key=key,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class CampaignOutcome:
    """How a campaign that reached its last point ended."""

    campaign_id: int
    accepted: int
    rejected: int
    settled: int
    power_off: PowerOffReport
    bench_seconds: float  # on the bench's clock


def planned(row: Mapping[Any, Any]) -> PlannedPoint:
    """A point of the plan, from its row in the ledger."""
    return PlannedPoint(
        point=int(row["point"]),
        repeat=int(row["repeat"]),
        kind=Kind(row["kind"]),
        D1=float(row["D1"]),
        D2=float(row["D2"]),
        power_W=float(row["P_set_W"]),
        why=str(row.get("why") or ""),
    )
