"""A database with a campaign in it, written step by step as a run writes it."""

from collections.abc import Mapping, Sequence

from bench.plan import Kind, PlannedPoint
from bench.process import Owner
from bench.states import PointState, State
from bench.store import LinkReport, Moment, Provenance, Settling, Store, StoredReading

LIMITS = {
    "voltage_V": 320,
    "current_A": 10,
    "power_W": 2200,
    "output_voltage_V": 160,
    "heatsink_C": 90,
    "winding_C": 120,
}
BENCH = "bench one"
LINK = LinkReport(
    resource="/dev/ttyUSB0", age_s=0.5, exchanges=1000, failures=20, last_error="no reply in 1 s"
)


def planned_points(count: int) -> list[PlannedPoint]:
    """Distinct set points along a diagonal."""
    return [
        PlannedPoint(
            point=k,
            repeat=0,
            kind=Kind.LOAD,
            D1=0.5 + 0.4 * k / count,
            D2=0.1,
            power_W=300.0 + 1000.0 * k / count,
        )
        for k in range(count)
    ]


def running_campaign(
    store: Store, count: int = 4, *, name: str = "first map", plan: Mapping[str, object] | None = None
) -> int:
    """A campaign that this process runs, its bench switched on, every point predicted."""
    rows = planned_points(count)
    provenance = Provenance(
        config={"bench": {"name": BENCH, "limits": LIMITS}, "campaign": {"plan": plan or {}}},
        config_hash="0",
        virtual=True,
        bench=BENCH,
    )
    campaign = store.create_campaign(name, provenance, rows)
    store.benches.take(BENCH, virtual=True, campaign_id=campaign, owner=Owner.here())
    store.benches.energise(BENCH, {"name": BENCH})
    store.move(campaign, State.PLANNED, State.CHECKING, time_s=0.0)
    store.predict(campaign, {id: {"efficiency": 0.98} for id in point_ids(store, campaign)}, time_s=0.0)
    store.move(campaign, State.CHECKING, State.RUNNING, time_s=1.0)
    return campaign


def point_ids(store: Store, campaign: int) -> list[int]:
    """The points of a campaign in the order of its plan."""
    return [row["id"] for row in store.planned(campaign)]


def measure(
    store: Store, campaign: int, numbers: Sequence[int], *, efficiency: float = 0.97, bad: str = ""
) -> None:
    """Take points from planned to judged; ``bad`` is why they are rejected."""
    plan = planned_points(store.campaign(campaign)["planned"])
    ids = point_ids(store, campaign)
    for number in numbers:
        row, id = plan[number], ids[number]
        for state in (PointState.SET, PointState.SETTLED):
            store.advance(campaign, id, state, time_s=1.0)
        told = {"D1": row.D1, "D2": row.D2, "P_set_W": row.power_W, "P2_W": row.power_W, "time_s": 1.0}
        told |= {"efficiency": efficiency, "u_efficiency": 0.001, "P1_W": row.power_W / efficiency}
        store.add_reading(campaign, id, StoredReading(numbers=told, settled=True, quality="good"))
        state = PointState.REJECTED if bad else PointState.ACCEPTED
        store.advance(campaign, id, state, time_s=1.0, reason=bad or None)


def moment_of(store: Store, campaign: int, *, phase: str = "settling", number: int = 0) -> Moment:
    """What such a campaign tells of itself."""
    return Moment(
        phase=phase,
        time_s=5.0,
        point_id=point_ids(store, campaign)[number],
        readings={"V1_V": 300.0, "I1_A": 11.0, "P1_W": 2150.0, "T_heatsink_C": 40.0},
        settling=Settling(elapsed_s=12.0, window_s=20.0, limit_s=600.0, moving="heatsink drifts by −0.2 K/s"),
        instruments={"analyzer": LINK},
    )
