"""The mock controller against the protocol's description: states, refusals, trips, the table."""

import struct
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.clock import StepClock
from drivers.controller_messages import (
    ARM,
    NACK,
    SET_MODULATION,
    TELEMETRY,
    Reason,
    Request,
    TableRow,
    fault_names,
    pack_table,
    unpack_table,
)
from drivers.frames import Frame, decode, encode
from drivers.mocks.controller import MockController
from tests.drivers.fake_plant import FakePlant


class Host:
    """Numbers requests and takes replies apart."""

    def __init__(self, **patience: Any) -> None:
        self.plant = FakePlant()
        self.mock = MockController(self.plant, **patience)
        self.sequence = 0
        self.ask(Request.IDENTIFY)

    def ask(self, type_: int, payload: bytes = b"", sequence: int | None = None) -> Frame:
        self.sequence = self.sequence + 1 if sequence is None else sequence
        reply = self.mock.handle(encode(Frame(self.sequence, type_, payload)))
        assert reply is not None
        return decode(reply[1:-1])

    def refused(self, type_: int, payload: bytes = b"", sequence: int | None = None) -> Reason:
        reply = self.ask(type_, payload, sequence)
        assert (reply.type, reply.payload[0]) == (NACK, type_)
        return Reason(reply.payload[1])

    def set(self, D1: float, D2: float) -> Frame:
        return self.ask(Request.SET_MODULATION, SET_MODULATION.pack(0, D1, D2))

    def run(self) -> None:
        self.set(0.7, 0.3)
        self.ask(Request.ARM, ARM.pack(2000))
        self.ask(Request.ENABLE)
        assert self.plant.present.pwm

    def faults(self) -> tuple[str, ...]:
        return fault_names(TELEMETRY.unpack(self.ask(Request.HEARTBEAT).payload)[1])


@pytest.fixture
def host() -> Host:
    return Host()


def test_enabling_needs_arming_and_a_set_point(host: Host) -> None:
    assert host.refused(Request.ENABLE) is Reason.NOT_ARMED
    host.ask(Request.ARM, ARM.pack(2000))
    assert host.refused(Request.ENABLE) is Reason.NO_SET_POINT
    assert not host.plant.present.pwm


@pytest.mark.parametrize(
    ("type_", "payload", "reason"),
    [
        (0x33, b"", Reason.UNKNOWN_TYPE),
        (Request.ENABLE, b"x", Reason.WRONG_LENGTH),
        (Request.SET_MODULATION, b"", Reason.WRONG_LENGTH),
        (Request.LOAD_TABLE, b"\x00\x02abc", Reason.WRONG_LENGTH),
        (Request.ARM, ARM.pack(9), Reason.OUT_OF_RANGE),
        (Request.ARM, ARM.pack(60_001), Reason.OUT_OF_RANGE),
        (Request.SET_MODULATION, SET_MODULATION.pack(5, 0.5, 0.5), Reason.UNKNOWN_MODE),
        (Request.SET_MODULATION, SET_MODULATION.pack(1, 0.5, 0.5), Reason.UNKNOWN_MODE),  # not this one's
        (Request.SET_MODULATION, SET_MODULATION.pack(0, 1.01, 0.5), Reason.OUT_OF_RANGE),
        (Request.SET_MODULATION, SET_MODULATION.pack(0, 0.5, float("nan")), Reason.OUT_OF_RANGE),
        (Request.USE_TABLE, b"\x01", Reason.BAD_TABLE),
    ],
)
def test_a_request_that_cannot_be_is_refused_with_the_reason(
    host: Host, type_: int, payload: bytes, reason: Reason
) -> None:
    assert host.refused(type_, payload) is reason


@pytest.mark.parametrize(
    ("D1", "D2", "possible"),
    [
        (1.0, 0.0, True),
        (0.016, 0.984, True),
        (0.984, 0.016, True),
        (0.01, 0.5, False),
        (0.99, 0.5, False),
        (0.5, 0.01, False),
        (0.5, 0.99, False),
    ],
)
def test_pulses_and_zero_states_are_no_shorter_than_the_dead_time(
    host: Host, D1: float, D2: float, possible: bool
) -> None:
    reply = host.set(D1, D2)
    assert (reply.type != NACK) == possible
    if not possible:
        assert reply.payload[1] == Reason.PULSE_TOO_SHORT


def test_a_set_point_out_of_range_leaves_the_old_one(host: Host) -> None:
    host.run()
    host.set(1.5, 0.3)
    assert (host.plant.present.pwm, host.plant.present.D1) == (True, 0.7)


@pytest.mark.parametrize("ahead", [0, -1, -1000, 0x8000])
def test_a_request_that_is_not_newer_is_refused(host: Host, ahead: int) -> None:
    host.run()
    sequence = (host.sequence + ahead) % 0x10000
    payload = SET_MODULATION.pack(0, 0.5, 0.5)
    assert host.refused(Request.SET_MODULATION, payload, sequence) is Reason.OUT_OF_ORDER
    assert host.plant.present.D1 == 0.7


@pytest.mark.parametrize(
    ("mode", "D2", "answer"), [(2, 0.3, None), (2, 0.2, Reason.OUT_OF_RANGE), (4, 0.3, Reason.UNKNOWN_MODE)]
)
def test_a_mode_takes_the_duties_that_it_has(host: Host, mode: int, D2: float, answer: Reason | None) -> None:
    payload = SET_MODULATION.pack(mode, 0.7, D2)
    if answer is None:
        host.ask(Request.SET_MODULATION, payload)
        assert host.plant.mode == "dps"
    else:
        assert host.refused(Request.SET_MODULATION, payload) == answer


def test_switching_off_is_always_carried_out(host: Host) -> None:
    host.run()
    host.ask(Request.DISABLE, sequence=1)
    assert not host.plant.present.pwm


def test_sequence_numbers_wrap_and_may_skip(host: Host) -> None:
    host.ask(Request.IDENTIFY, sequence=0xFFFE)
    for sequence in (0xFFFF, 3, 0x7000):
        assert host.ask(Request.HEARTBEAT, sequence=sequence).type != NACK


def test_nothing_but_identification_begins_a_session() -> None:
    mock = MockController(FakePlant())
    reply = mock.handle(encode(Frame(1, Request.HEARTBEAT)))
    assert reply is not None
    assert decode(reply[1:-1]).payload == bytes([Request.HEARTBEAT, Reason.OUT_OF_ORDER])


def test_what_is_not_a_frame_gets_no_reply_and_does_not_beat(host: Host) -> None:
    host.run()
    beat = bytearray(encode(Frame(host.sequence + 1, Request.HEARTBEAT)))
    beat[-2] ^= 1
    assert host.mock.handle(bytes(beat)) is None
    assert host.mock.handle(b"\x00\x00noise\x00") is None


def test_frames_may_come_in_pieces_and_together(host: Host) -> None:
    one, two = encode(Frame(2, Request.HEARTBEAT)), encode(Frame(3, Request.HEARTBEAT))
    assert host.mock.handle(one[:4]) is None
    replies = host.mock.handle(one[4:] + two)
    assert replies is not None
    assert [decode(part).sequence for part in replies.split(b"\x00") if part] == [2, 3]


def test_a_killed_host_trips_the_pwm_by_the_tick_alone(host: Host) -> None:
    host.run()
    host.plant.clock.sleep(8.0)
    host.mock.tick()
    assert host.plant.present.pwm
    host.plant.clock.sleep(0.01)
    host.mock.tick()
    assert not host.plant.present.pwm
    assert host.refused(Request.ENABLE) is Reason.FAULT_STANDS
    assert host.faults() == ("heartbeat_lost",)


@pytest.mark.parametrize(("stalled_s", "pwm"), [(9.9, True), (10.0, False)])
def test_on_a_fast_clock_a_late_beat_is_waited_for_in_real_time(stalled_s: float, pwm: bool) -> None:
    real = StepClock()
    host = Host(patience_s=10.0, real_s=real.now)
    host.run()
    real.sleep(stalled_s)
    host.plant.clock.sleep(100 * stalled_s)
    host.mock.tick()
    assert host.plant.present.pwm is pwm


def test_real_time_alone_trips_nothing() -> None:
    real = StepClock()
    host = Host(patience_s=10.0, real_s=real.now)
    host.run()
    real.sleep(60.0)
    host.mock.tick()
    assert host.plant.present.pwm


def test_each_beat_is_waited_for_anew() -> None:
    real = StepClock()
    host = Host(patience_s=10.0, real_s=real.now)
    host.run()
    for _ in range(3):
        real.sleep(6.0)
        host.plant.clock.sleep(600.0)
        assert host.faults() == ()
    assert host.plant.present.pwm


def test_only_beats_count_as_beats(host: Host) -> None:
    host.run()
    for _ in range(5):
        host.plant.clock.sleep(2.0)
        host.set(0.7, 0.3)
    assert not host.plant.present.pwm


def test_the_heartbeat_period_is_the_armed_one(host: Host) -> None:
    host.set(0.7, 0.3)
    host.ask(Request.ARM, ARM.pack(100))
    host.ask(Request.ENABLE)
    host.plant.clock.sleep(0.41)
    host.mock.tick()
    assert not host.plant.present.pwm


def test_arming_while_the_pwm_is_on_is_refused(host: Host) -> None:
    host.run()
    assert host.refused(Request.ARM, ARM.pack(2000)) is Reason.PWM_IS_ON


def test_a_fault_of_the_plant_trips_and_stays_until_armed_anew(host: Host) -> None:
    """The plant shows its fault until the PWM goes on again; arming acknowledges it."""
    host.run()
    host.plant.present = replace(host.plant.present, faults=("overtemperature", "input undervoltage"))
    assert host.faults() == ("heatsink_overtemperature", "input_undervoltage")
    assert not host.plant.present.pwm
    assert host.refused(Request.ENABLE) is Reason.FAULT_STANDS
    host.ask(Request.ARM, ARM.pack(2000))
    host.ask(Request.ENABLE)
    assert host.faults() == ()
    assert host.plant.present.pwm


def test_a_fault_that_is_still_there_trips_again(host: Host) -> None:
    host.run()
    host.plant.broken = ("output undervoltage",)
    for _ in range(2):
        host.ask(Request.DISABLE)
        host.ask(Request.ARM, ARM.pack(2000))
        host.ask(Request.ENABLE)
        assert host.faults() == ("output_undervoltage",)
        assert not host.plant.present.pwm


ROWS = (
    TableRow(power_W=200.0, D1=0.5, D2=0.0),
    TableRow(power_W=1000.0, D1=0.9, D2=0.08),
    TableRow(power_W=2000.0, D1=1.0, D2=0.0),
)


@pytest.mark.parametrize(
    ("power_W", "D1", "D2"),
    [
        (0.0, 0.5, 0.0),
        (200.0, 0.5, 0.0),
        (600.0, 0.7, 0.04),
        (1000.0, 0.9, 0.08),
        (1850.0, 0.984, 0.016),  # for 0.985 and 0.012: zero states of less than the dead time, 0.016
        (1950.0, 1.0, 0.0),  # for 0.995 and 0.004
        (5000.0, 1.0, 0.0),
    ],
)
def test_the_table_is_interpolated_and_kept_makeable(
    host: Host, power_W: float, D1: float, D2: float
) -> None:
    host.ask(Request.LOAD_TABLE, pack_table(0, ROWS))
    host.plant.set_load(on=True, power_W=power_W)
    host.ask(Request.USE_TABLE, b"\x01")
    applied = host.plant.present
    half_a_count = 0.5001 / 2500
    assert abs(applied.D1 - D1) < half_a_count
    assert abs(applied.D2 - D2) < half_a_count


def test_a_set_point_ends_the_use_of_the_table(host: Host) -> None:
    host.ask(Request.LOAD_TABLE, pack_table(0, ROWS))
    host.ask(Request.USE_TABLE, b"\x01")
    host.set(0.7, 0.3)
    host.ask(Request.HEARTBEAT)
    assert (host.plant.present.D1, host.plant.present.D2) == (0.7, 0.3)


def test_the_table_is_read_back_in_whole_counts(host: Host) -> None:
    host.ask(Request.LOAD_TABLE, pack_table(0, (ROWS[0], replace(ROWS[1], D1=0.90001))))
    mode, rows = unpack_table(host.ask(Request.READ_TABLE).payload)
    assert (mode, len(rows)) == (0, 2)
    (single,) = struct.unpack("<f", struct.pack("<f", 0.9))
    assert single == rows[1].D1


@pytest.mark.parametrize("rows", [(), ROWS[:1], ROWS[::-1], (ROWS[0], ROWS[0])])
def test_a_table_that_cannot_be_used_is_refused(host: Host, rows: tuple[TableRow, ...]) -> None:
    assert host.refused(Request.LOAD_TABLE, pack_table(0, rows)) is Reason.BAD_TABLE


@given(chunk=st.binary(max_size=80), type_=st.integers(0, 255), payload=st.binary(max_size=40))
def test_nothing_that_is_sent_breaks_it(chunk: bytes, type_: int, payload: bytes) -> None:
    host = Host()
    host.mock.handle(chunk)
    host.mock.handle(encode(Frame(2, type_, payload)))
    assert host.ask(Request.IDENTIFY).type == Request.IDENTIFY | 0x80
