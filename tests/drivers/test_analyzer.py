"""The power analyzer's driver: dialogues byte for byte, and the same driver against the mock."""

import math
import struct
from collections.abc import Iterator

import pytest

from drivers.analyzer import NOT_SCALED, SCALED, Analyzer, load_analyzer_model
from drivers.clock import StepClock
from drivers.errors import (
    IdentityError,
    InstrumentRefused,
    LimitError,
    LinkTimeout,
    ReadbackError,
    ReplyError,
)
from drivers.mocks.scpi_analyzer import ScpiAnalyzer
from drivers.mocks.wire import PtyServer
from drivers.reading import Quality
from drivers.transport import ByteLink, Patience
from tests.drivers.fake_plant import FakePlant
from tests.drivers.scripted_port import ScriptedPort, dialogue

WT3000 = load_analyzer_model("wt3000")

IDENTIFY = """
    > *CLS
    > *OPC?
    < 1
    > *IDN?
    < YOKOGAWA,760304-40-MV,0,F5.01
"""


def checked(*commands: str) -> str:
    """Each command followed by the question for errors, of which there is none."""
    return "\n".join(f'> {command}\n> :STATUS:ERROR?\n< 0,"No error"' for command in commands)


START = checked(
    ":COMMUNICATE:HEADER OFF", ":COMMUNICATE:VERBOSE OFF", ":NUMERIC:HOLD OFF", ":STATUS:FILTER1 FALL"
)
SCALING = """
    > :INPUT:SCALING:STATE?
    < 0;0;0;0
"""
CONFIGURE = f"""
    {START}
    {checked(":MEASURE:AVERAGING:STATE OFF")}
    {checked(":NUMERIC:FORMAT ASCII", ":NUMERIC:NORMAL:NUMBER 2")}
    {checked(":NUMERIC:NORMAL:ITEM1 UDC,1", ":NUMERIC:NORMAL:ITEM2 P,1", ":RATE 500MS")}
    > :RATE?
    < 500.0E-03
    > :NUMERIC:NORMAL:NUMBER?
    < 2
    {checked(":INPUT:CURRENT:AUTO:ELEMENT1 ON", ":INPUT:VOLTAGE:AUTO:ELEMENT1 OFF")}
    {checked(":INPUT:VOLTAGE:RANGE:ELEMENT1 300V")}
    > :INPUT:VOLTAGE:RANGE:ELEMENT1?
    < 300.0E+00
"""


def update(values: str, condition: int = 0, queries: int = 1) -> str:
    """One update's exchanges: clear the event, let the instrument wait, read the values."""
    read = f"> :STATUS:EESR?\n< 1\n> :COMMUNICATE:WAIT 1\n> :NUMERIC:NORMAL:VALUE?\n< {values}\n"
    return read * queries + f"> :STATUS:CONDITION?\n< {condition}"


def scripted(text: str) -> Analyzer:
    return Analyzer(ByteLink(ScriptedPort(dialogue(text)), "scripted"), WT3000, clock=StepClock(7.0))


def configured(text: str) -> Analyzer:
    analyzer = scripted(CONFIGURE + text)
    analyzer.configure(["U1", "P1"], 0.5, {"U1": 300.0})
    return analyzer


# --- dialogues --------------------------------------------------------------------------------------


def test_identifies_by_the_model_code_and_makes_replies_plain() -> None:
    analyzer = scripted(IDENTIFY + START + SCALING)
    identity = analyzer.identify()
    assert (identity.maker, identity.model, identity.firmware) == ("YOKOGAWA", "760304-40-MV", "F5.01")
    assert identity.serial == "", "these instruments tell no serial number: the field is always 0"
    analyzer.close()


@pytest.mark.parametrize(
    ("reply", "scaled", "said"),
    [
        ("0;0;0;0", False, None),
        ("0", False, None),
        ("0;1;0;0", False, SCALED),
        (":INPUT:SCALING:STATE:ELEMENT1 0;ELEMENT2 1;ELEMENT3 0;ELEMENT4 0", False, SCALED),
        ("1", True, None),
        ("OFF", True, NOT_SCALED),
    ],
)
def test_scaling_that_somebody_left_or_took_is_a_problem(reply: str, scaled: bool, said: str | None) -> None:
    analyzer = scripted(IDENTIFY + START + SCALING.replace("0;0;0;0", reply))
    analyzer.identify()
    problems = analyzer.problems(["U1", "P1"], 0.5, {}, scaled=scaled)
    assert problems == [said] * bool(said)
    if said:
        with pytest.raises(
            LimitError, match=said.partition(":")[0]
        ):  # and nothing is sent: the script ends here
            analyzer.configure(["U1", "P1"], 0.5, scaled=scaled)


def test_scaling_that_is_no_switch_is_no_reply() -> None:
    with pytest.raises(ReplyError, match="not switches"):
        scripted(IDENTIFY + START + SCALING.replace("0;0;0;0", "0;2")).identify()


@pytest.mark.parametrize("idn", ["YOKOGAWA,WT310-C2-H,C2PH13019V,F1.01", "ACME,760304-40-MV,0,F5.01"])
def test_another_instrument_is_not_spoken_to(idn: str) -> None:
    """Nothing is sent to it after its answer to *IDN?: the script ends there."""
    with pytest.raises(IdentityError, match="WT3000"):
        scripted(IDENTIFY.replace("YOKOGAWA,760304-40-MV,0,F5.01", idn)).identify()


def test_configures_item_by_item_and_reads_back() -> None:
    configured("").close()


def test_the_ac_link_is_measured_by_rms_and_dc_ports_by_their_mean() -> None:
    items = checked(":NUMERIC:NORMAL:ITEM1 IDC,1", ":NUMERIC:NORMAL:ITEM2 IRMS,2")
    head = checked(":NUMERIC:FORMAT ASCII", ":NUMERIC:NORMAL:NUMBER 2")
    steady = checked(":MEASURE:AVERAGING:STATE OFF")
    analyzer = scripted(f"{START}\n{steady}\n{head}\n{items}")
    with pytest.raises(AssertionError, match=":RATE"):  # where this script ends
        analyzer.configure(["I1", "I2"], 0.5, ac_elements={2})


def test_reads_a_fresh_update() -> None:
    analyzer = configured(update("299.987E+00,609.450E+00"))
    readings = analyzer.read()
    assert {name: reading.value for name, reading in readings.items()} == {"U1": 299.987, "P1": 609.45}
    assert (readings["P1"].unit, readings["P1"].time_s, readings["P1"].good) == ("W", 7.0, True)
    analyzer.close()


def test_headers_are_parsed_though_they_were_switched_off() -> None:
    analyzer = configured(
        update(":NUMERIC:NORMAL:VALUE 299.987E+00,609.450E+00").replace("< 0", "< :STATUS:CONDITION 0")
    )
    assert analyzer.read()["U1"].value == 299.987


def test_words_for_missing_and_too_large_values_become_qualities() -> None:
    readings = configured(update("NAN,INF")).read()
    assert [readings[name].quality for name in ("U1", "P1")] == [Quality.NO_DATA, Quality.OVERRANGE]
    assert math.isnan(readings["U1"].value)


@pytest.mark.parametrize("condition", [1 << 8, 1 << 15, 1 << 8 | 1])
def test_a_condition_bit_spoils_its_element(condition: int) -> None:
    readings = configured(update("299.987E+00,609.450E+00", condition)).read()
    assert {reading.quality for reading in readings.values()} == {Quality.OVERRANGE}


@pytest.mark.parametrize("condition", [1, 2, 1 << 9, 1 << 11])
def test_other_condition_bits_do_not(condition: int) -> None:
    assert configured(update("299.987E+00,609.450E+00", condition)).read()["U1"].good


def test_condition_bits_are_data_of_the_model() -> None:
    """Bit 7 is a voltage peak of element 1 on a WT310; on a WT3000 it has to do with harmonics."""
    bits = {(bit.bit, bit.element) for bit in load_analyzer_model("wt310").condition}
    assert (7, 1) in bits
    assert (8, 2) not in bits
    assert not any(bit.bit == 7 for bit in WT3000.condition)


def test_a_repeated_record_is_asked_for_again() -> None:
    first, second = "299.987E+00,609.450E+00", "299.988E+00,609.450E+00"
    repeated = update(first).rpartition("> :STATUS:CONDITION")[0]
    analyzer = configured(f"{update(first)}\n{repeated}{update(second)}")
    analyzer.read()
    reading = analyzer.read()["U1"]
    assert (reading.value, reading.quality) == (299.988, Quality.GOOD)
    analyzer.close()


@pytest.mark.parametrize("values", ["299.987E+00,609.450E+00", "299.987E+00,0.00000E+00"])
def test_a_record_that_never_changes_is_stale(values: str) -> None:
    twice = update(values, queries=2).rpartition("> :STATUS:CONDITION")[0]
    unfrozen = checked(":NUMERIC:HOLD OFF")
    analyzer = configured(f"{update(values)}\n{twice}{unfrozen}\n{update(values)}")
    assert analyzer.read()["U1"].quality is Quality.GOOD
    assert {reading.quality for reading in analyzer.read().values()} == {Quality.STALE}
    analyzer.close()


@pytest.mark.parametrize("values", ["NAN,NAN", "0.00000E+00,0.00000E+00"])
def test_a_record_that_tells_nothing_may_repeat(values: str) -> None:
    """Inputs that are switched off read zero, rounded, again and again."""
    analyzer = configured(f"{update(values)}\n{update(values)}")
    analyzer.read()
    assert Quality.STALE not in {reading.quality for reading in analyzer.read().values()}


@pytest.mark.parametrize(
    "values", ["299.987E+00", "1.0E+00,2.0E+00,3.0E+00", "299.987E+00,609.450E", "299.987E+00,609.4"]
)
def test_a_record_of_another_length_or_cut_short_is_no_reply(values: str) -> None:
    with pytest.raises(ReplyError):
        configured(update(values)).read()


def test_a_refused_item_names_command_and_reason() -> None:
    script = CONFIGURE.replace(
        '> :NUMERIC:NORMAL:ITEM2 P,1\n> :STATUS:ERROR?\n< 0,"No error"',
        '> :NUMERIC:NORMAL:ITEM2 P,1\n> :STATUS:ERROR?\n< 141,"Invalid character data"\n'
        '> :STATUS:ERROR?\n< 0,"No error"',
    )
    with pytest.raises(InstrumentRefused, match=r"ITEM2 P,1.*141"):
        scripted(script).configure(["U1", "P1"], 0.5, {"U1": 300.0})


@pytest.mark.parametrize(
    ("reply", "wrong", "what"),
    [
        ("< 300.0E+00", "< 600.0E+00", "range U1"),
        ("< 500.0E-03", "< 1.000E+00", "update interval"),
        ("< 2\n", "< 15\n", "number of items"),
    ],
)
def test_a_setting_that_reads_back_differently_is_an_error(reply: str, wrong: str, what: str) -> None:
    with pytest.raises(ReadbackError, match=what):
        scripted(CONFIGURE.replace(reply, wrong)).configure(["U1", "P1"], 0.5, {"U1": 300.0})


@pytest.mark.parametrize(
    ("items", "update_s", "ranges", "what"),
    [
        (["U5"], 0.5, {}, "element"),
        ([], 0.5, {}, "0 items"),
        (["U1", "U1"], 0.5, {}, "twice"),
        (["Q1"], 0.5, {}, "'Q1'"),
        (["U1"], 0.3, {}, "0.3 s"),
        (["U1"], 0.5, {"U1": 250.0}, "15, 30"),
        (["U1"], 0.5, {"P1": 300.0}, "power has no range"),
        (["U1"], 0.5, {"I7": 10.0}, "I7"),
    ],
)
def test_what_the_instrument_has_not_is_refused_before_anything_is_sent(
    items: list[str], update_s: float, ranges: dict[str, float], what: str
) -> None:
    with pytest.raises(LimitError, match=what):
        scripted("").configure(items, update_s, ranges)


def test_all_problems_are_told_at_once() -> None:
    with pytest.raises(LimitError, match=r"U9.*0\.3 s.*250"):
        scripted("").configure(["U9"], 0.3, {"U1": 250.0})


def test_reading_before_configuring_is_an_error() -> None:
    with pytest.raises(ReplyError, match="configure"):
        scripted("").read()


def test_a_model_that_is_not_there_names_those_that_are() -> None:
    with pytest.raises(ValueError, match="wt3000, wt310"):
        load_analyzer_model("wt9999")


def test_accuracy_at_dc_is_that_of_reading_and_range() -> None:
    """600 W on 300 V and 5 A: 0.05 % of 600 W and 0.1 % of 1500 W."""
    assert WT3000.error_limit("P", "dc", 600.0, 300.0 * 5.0) == pytest.approx(1.8, rel=1e-12)
    with pytest.raises(LookupError):
        WT3000.error_limit("U", "ac", 300.0, 300.0)


# --- against the mock, over a pseudo-terminal ------------------------------------------------------


@pytest.fixture
def plant() -> FakePlant:
    return FakePlant()


@pytest.fixture
def analyzer(plant: FakePlant) -> Iterator[Analyzer]:
    mock = ScpiAnalyzer(plant)
    # a crashed run
    mock.handle(b":NUMERIC:HOLD ON\n:NUMERIC:FORMAT FLOAT\n:STATUS:FILTER1 NEVER\n:BLUNDER\n")
    with PtyServer(mock.handle) as server, ByteLink.open(server.path) as link:
        analyzer = Analyzer(link, WT3000, clock=plant.clock)
        analyzer.identify()
        yield analyzer


ALL = [f"{quantity}{element}" for element in (1, 2, 3, 4) for quantity in "UIP"]


def test_each_reading_is_of_the_next_update(plant: FakePlant, analyzer: Analyzer) -> None:
    """Update n of the fake plant adds n millivolts; the clock steps by one update for each reading."""
    analyzer.configure(ALL, 0.5, {"U1": 300.0, "I1": 5.0})
    started = round(plant.clock.now() / 0.5)
    for n in range(1, 6):
        readings = analyzer.read()
        assert all(reading.good for reading in readings.values())
        assert readings["U1"].value == pytest.approx(300.0 + 0.001 * (started + n), abs=1e-6)
        assert plant.clock.now() == pytest.approx(0.5 * (started + n), abs=1e-9)
    assert readings["P4"].value == pytest.approx(870.0, rel=1e-5)  # six digits on the wire


def test_binary_blocks_give_the_same_values(plant: FakePlant) -> None:
    with PtyServer(ScpiAnalyzer(plant).handle) as server, ByteLink.open(server.path) as link:
        analyzer = Analyzer(link, WT3000, clock=plant.clock, binary=True)
        analyzer.configure(["P3", "I4"], 0.5, {"I4": 1.0})
        readings = analyzer.read()
    assert readings["P3"].value == struct.unpack(">f", struct.pack(">f", 930.0))[0]
    assert readings["I4"].quality is Quality.OVERRANGE


def test_a_range_too_small_is_over_range_with_its_power(analyzer: Analyzer) -> None:
    analyzer.configure(ALL, 0.5, {"I2": 2.0})
    readings = analyzer.read()
    assert {name for name, reading in readings.items() if reading.quality is Quality.OVERRANGE} == {
        "U2",
        "I2",
        "P2",
    }
    assert readings["U2"].value == 140.0, "the condition bit spoils the element; the value is still told"


def test_ranges_are_read_from_the_instrument(analyzer: Analyzer) -> None:
    analyzer.configure(["P1"], 0.5, {"U1": 300.0, "I1": 5.0})
    assert analyzer.ranges() == {"U1": 300.0, "I1": 5.0}
    analyzer.set_ranges({"I1": 2.0})
    assert analyzer.ranges() == {"U1": 300.0, "I1": 2.0}
    assert analyzer.read()["P1"].good


def test_automatic_ranges_settle(analyzer: Analyzer) -> None:
    """300 V, 2 A, 140 V, 4 A: the smallest ranges of which each is at most 110 %."""
    analyzer.configure(ALL[:6], 0.5)
    qualities = [analyzer.read()["P1"].quality for _ in range(3)]
    assert qualities[-1] is Quality.GOOD
    assert analyzer.ranges() == {"U1": 300.0, "I1": 2.0, "U2": 150.0, "I2": 5.0}


def test_a_hold_that_comes_later_is_ended(plant: FakePlant) -> None:
    mock = ScpiAnalyzer(plant)
    with PtyServer(mock.handle) as server, ByteLink.open(server.path) as link:
        analyzer = Analyzer(link, WT3000, clock=plant.clock)
        analyzer.configure(["U1"], 0.5, {"U1": 300.0})
        held = analyzer.read()["U1"].value
        link.write(b":NUMERIC:HOLD ON\n")  # somebody pressed the key
        reading = analyzer.read()["U1"]
        assert reading.good
        assert reading.value > held  # each update adds a millivolt


def test_without_the_event_filter_the_instrument_waits_for_ever(plant: FakePlant) -> None:
    mock = ScpiAnalyzer(plant)
    with PtyServer(mock.handle) as server, ByteLink.open(server.path) as link:
        analyzer = Analyzer(link, WT3000, clock=plant.clock, speed=1000.0, patience=Patience(timeout_s=0.1))
        analyzer.configure(["U1"], 0.05, {"U1": 300.0})
        link.write(b":STATUS:FILTER1 NEVER\n")
        with pytest.raises(LinkTimeout):
            analyzer.read()
