"""The tables of the campaign database, and the columns of the measurement table."""

from sqlalchemy import JSON, Boolean, Column, Float, ForeignKey, Integer, MetaData, String, Table, Text

metadata = MetaData()

# Numbers of the measurement table, in the order of an export; energies in SI, temperatures in degC.
NUMBERS = (
    "time_s", "D1", "D2", "P_set_W", "D0", "V1_V", "I1_A", "P1_W", "V2_V", "I2_A", "P2_W", "efficiency",
    "I_L_rms_A", "P_link1_W", "P_link2_W", "T_ambient_C", "T_heatsink_C", "T_transformer_C", "T_inductor_C",
    "range_U1_V", "range_I1_A", "range_U2_V", "range_I2_A", "u_P1_W", "u_P2_W", "u_efficiency",
)  # fmt: skip
COLUMNS = ("point", "repeat", "kind", *NUMBERS, "settled", "quality")

campaigns = Table(
    "campaigns",
    metadata,
    Column("id", Integer, primary_key=True),
    Column("name", String, nullable=False),
    Column("state", String, nullable=False),
    Column("virtual", Boolean, nullable=False),  # data of a virtual lab can never pass for hardware data
    Column("created", String, nullable=False),
    Column("ended", String),
    Column("planned", Integer, nullable=False),
    Column("request", String),  # pause or abort, asked for from another process
    Column("process", Integer),  # who runs it
    Column("error", Text),
    Column("power_off", Text),
    Column("config", JSON, nullable=False),
    Column("config_hash", String, nullable=False),
    Column("versions", JSON, nullable=False),
    Column("instruments", JSON, nullable=False),
    sqlite_autoincrement=True,
)

points = Table(
    "points",
    metadata,
    Column("id", Integer, primary_key=True),
    Column("campaign_id", ForeignKey("campaigns.id"), nullable=False, index=True),
    Column("point", Integer),
    Column("repeat", Integer),
    Column("kind", String, nullable=False),
    Column("D1", Float),
    Column("D2", Float),
    Column("P_set_W", Float),
    Column("state", String, nullable=False),
    Column("reason", Text),
    Column("predicted", JSON, nullable=False),
)

readings = Table(
    "readings",
    metadata,
    Column("id", Integer, primary_key=True),
    Column("campaign_id", ForeignKey("campaigns.id"), nullable=False, index=True),
    Column("point_id", ForeignKey("points.id"), nullable=False, index=True),
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
