"""The tables of the campaign database, and the columns of the measurement table."""

from sqlalchemy import (
    JSON,
    Boolean,
    Column,
    Float,
    ForeignKey,
    Integer,
    Label,
    MetaData,
    String,
    Table,
    Text,
    UniqueConstraint,
    select,
)

SCHEMA = 2  # of the tables below; a database of another one is refused

metadata = MetaData()

# Numbers of the measurement table, in the order of an export; in SI units, temperatures in degC.
NUMBERS = (
    "time_s", "D1", "D2", "P_set_W", "D0", "V1_V", "I1_A", "P1_W", "V2_V", "I2_A", "P2_W", "efficiency",
    "I_L_rms_A", "P_link1_W", "P_link2_W", "T_ambient_C", "T_heatsink_C", "T_transformer_C", "T_inductor_C",
    "range_U1_V", "range_I1_A", "range_U2_V", "range_I2_A", "u_P1_W", "u_P2_W", "u_efficiency",
)  # fmt: skip
SETTINGS = ("time_s", "D1", "D2", "P_set_W")  # of these, known although nothing was measured
COLUMNS = ("point", "repeat", "kind", *NUMBERS, "settled", "quality", "lab")
CHOICE = "choice"  # event: what a campaign that chooses its points goes by
CHOSEN = "chosen"  # event of a point: why it was
VIRTUAL, HARDWARE = "virtual", "hardware"  # values of the column lab

schema = Table("d2ea_schema", metadata, Column("version", Integer, primary_key=True))

campaigns = Table(
    "campaigns",
    metadata,
    Column("id", Integer, primary_key=True),
    Column("key", String, unique=True),  # of who asked for it: asked twice, it is made once
    Column("name", String, nullable=False),
    Column("bench", String, index=True),
    Column("state", String, nullable=False),
    Column("virtual", Boolean, nullable=False),  # data of a virtual lab can never pass for hardware data
    Column("created", String, nullable=False),
    Column("ended", String),
    Column("planned", Integer, nullable=False),
    Column("request", String),  # pause or abort, asked for from another process
    Column("host", String),  # who runs it
    Column("process", Integer),
    Column("began", String),
    Column("error", Text),
    Column("power_off", Text),
    Column("config", JSON, nullable=False),
    Column("config_hash", String, nullable=False),
    Column("versions", JSON, nullable=False),
    Column("instruments", JSON, nullable=False),
    sqlite_autoincrement=True,
)

sessions = Table(  # one per start and per resume: the provenance of the rows measured in it
    "sessions",
    metadata,
    Column("id", Integer, primary_key=True),
    Column("campaign_id", ForeignKey("campaigns.id"), nullable=False, index=True),
    Column("started", String, nullable=False),
    Column("host", String, nullable=False),
    Column("process", Integer, nullable=False),
    Column("began", String, nullable=False),
    Column("seed", Integer),
    Column("config_hash", String, nullable=False),
    Column("bench", JSON, nullable=False),  # the bench's settings in this session
    Column("versions", JSON, nullable=False),
    Column("instruments", JSON, nullable=False),
    Column("offset_s", Float, nullable=False),  # campaign time at which this session began
)

points = Table(
    "points",
    metadata,
    Column("id", Integer, primary_key=True),
    Column("campaign_id", ForeignKey("campaigns.id"), nullable=False, index=True),
    Column("position", Integer, nullable=False),  # in the plan
    Column("point", Integer),
    Column("repeat", Integer),
    Column("kind", String, nullable=False),
    Column("D1", Float),
    Column("D2", Float),
    Column("P_set_W", Float),
    Column("state", String, nullable=False),
    Column("reason", Text),
    Column("attempts", Integer, nullable=False, default=0),
    Column("predicted", JSON, nullable=False),
    UniqueConstraint("campaign_id", "position"),
)

readings = Table(
    "readings",
    metadata,
    Column("id", Integer, primary_key=True),
    Column("campaign_id", ForeignKey("campaigns.id"), nullable=False, index=True),
    Column("point_id", ForeignKey("points.id"), nullable=False, unique=True),  # never twice
    Column("session_id", ForeignKey("sessions.id")),
    *(Column(name, Float) for name in NUMBERS),
    Column("settled", Boolean),
    Column("quality", String),
    Column("samples", JSON),  # the single updates behind the row
)

events = Table(
    "events",
    metadata,
    Column("id", Integer, primary_key=True),
    Column("campaign_id", ForeignKey("campaigns.id"), nullable=False, index=True),
    Column("point_id", ForeignKey("points.id")),
    Column("time_s", Float),
    Column("written", String, nullable=False),
    Column("event", String, nullable=False),
    Column("detail", Text),
)

benches = Table(
    "benches",
    metadata,
    Column("name", String, primary_key=True),
    Column("virtual", Boolean, nullable=False),
    Column("campaign_id", ForeignKey("campaigns.id")),  # whose it is; None when nobody's
    Column("host", String),
    Column("process", Integer),
    Column("began", String),
    Column("energised", Boolean, nullable=False),  # switched on, and since then not seen off
    Column("unsafe", Text),  # why it is UNSAFE; None when it is not
    Column("unsafe_since", String),
    Column("said", Text),  # how it was last seen off
    Column("seen_off", String),
    Column("config", JSON),  # of the campaign that last switched it on: how to reach it
)

live = Table(  # what is going on now; may be lost with the machine, unlike everything else here
    "live",
    metadata,
    Column("campaign_id", ForeignKey("campaigns.id"), primary_key=True),
    Column("written", String, nullable=False),
    Column("time_s", Float),
    Column("point_id", Integer),
    Column("phase", String, nullable=False),
    Column("settling", JSON),
    Column("readings", JSON),
    Column("instruments", JSON),
    Column("faults", JSON),
)

queue = Table(
    "queue",
    metadata,
    Column("id", Integer, primary_key=True),
    Column("name", String, nullable=False),
    Column("bench", String, nullable=False),
    Column("campaign_config", JSON, nullable=False),
    Column("bench_config", JSON, nullable=False),
    Column("added", String, nullable=False),
    Column("due", String),  # UTC; None: as soon as the bench is free
    Column("every_s", Float),
    Column("runs", Integer, nullable=False),
    Column("state", String, nullable=False),
    Column("said", Text),
    Column("campaign_id", ForeignKey("campaigns.id")),  # of the last run
    sqlite_autoincrement=True,
)

models = Table(
    "models",
    metadata,
    Column("id", Integer, primary_key=True),
    Column("campaign_id", ForeignKey("campaigns.id")),
    Column("created", String, nullable=False),
    Column("model", String, nullable=False),
    Column("detail", JSON, nullable=False),
)

diagnoses = Table(
    "diagnoses",
    metadata,
    Column("id", Integer, primary_key=True),
    Column("campaign_id", ForeignKey("campaigns.id")),
    Column("created", String, nullable=False),
    Column("verdict", JSON, nullable=False),
)


def why() -> Label[str | None]:
    """Column ``why`` of a query of points: the question that a chosen one answers, None for the others."""
    told = select(events.c.detail).where(events.c.point_id == points.c.id, events.c.event == CHOSEN)
    return told.scalar_subquery().label("why")
