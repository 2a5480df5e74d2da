"""The controller's driver: wrong replies, and the mock over a pseudo-terminal."""

import struct
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import pytest

from drivers.controller import Controller, TableRow
from drivers.controller_messages import (
    APPLIED,
    ARM,
    IDENTITY,
    NACK,
    REFUSAL,
    TELEMETRY,
    Reason,
    Request,
    pack_table,
)
from drivers.errors import (
    InstrumentRefused,
    InstrumentTripped,
    LimitError,
    LinkTimeout,
    LinkUnavailable,
    ReadbackError,
    ReplyError,
    SetPointRefused,
)
from drivers.frames import Frame, decode, encode
from drivers.mocks.controller import MockController
from drivers.mocks.wire import PtyServer
from drivers.transport import ByteLink
from tests.drivers.fake_plant import FakePlant
from tests.drivers.scripted_port import ScriptedPort

SOON_S = 0.05
ROWS = (TableRow(power_W=200.0, D1=0.5, D2=0.25), TableRow(power_W=1100.0, D1=1.0, D2=0.0))


# --- wrong replies ----------------------------------------------------------------------------------

Answer = Callable[[Frame], bytes]


class Answering:
    """Identifies itself properly, and answers every other request as it is told."""

    def __init__(self, answer: Answer) -> None:
        self.answer = answer
        self.requests: list[Frame] = []
        self._waiting = bytearray()

    @property
    def in_waiting(self) -> int:
        return len(self._waiting)

    def read(self, size: int = 1, /) -> bytes:
        data = bytes(self._waiting[:size])
        del self._waiting[:size]
        return data

    def write(self, data: bytes, /) -> int:
        request = decode(data[1:-1])
        self.requests.append(request)
        if request.type == Request.IDENTIFY:
            payload = IDENTITY.pack(1000, 64) + b"maker,model,serial,1.0"
            self._waiting += encode(Frame(request.sequence, 0x81, payload))
        else:
            self._waiting += self.answer(request)
        return len(data)

    def close(self) -> None: ...


def talking(answer: Answer) -> tuple[Controller, Answering]:
    port = Answering(answer)
    return Controller(ByteLink(port, "scripted"), timeout_s=SOON_S, lateness_s=0.0), port


def beat(request: Frame, **change: Any) -> bytes:
    payload = TELEMETRY.pack(0, 0, 0, 0, 0.25, 140.0, 40.0, 50.0, 60.0, 25.0)
    return encode(replace(Frame(request.sequence, request.type | 0x80, payload), **change))


def corrupted(request: Frame) -> bytes:
    wire = bytearray(beat(request))
    wire[-2] ^= 0x40
    return bytes(wire)


@pytest.mark.parametrize(
    ("answer", "reason"),
    [
        (lambda r: beat(r, sequence=r.sequence - 1), "request 1 came; request 2"),
        (lambda r: beat(r, sequence=r.sequence + 1), "request 3 came; request 2"),
        (lambda r: beat(r, type=0x85), "type 0x85"),
        (lambda r: beat(r, payload=b"short"), "5 bytes"),
        (corrupted, "CRC|not a frame"),
        (encode, "echo"),
        (lambda r: beat(r, type=NACK, payload=REFUSAL.pack(Request.ENABLE, 7)), "0x04 is refused"),
        (lambda r: b"garbage\x00" + beat(r), "not a frame"),
    ],
    ids=["replayed", "ahead", "other type", "wrong length", "bad CRC", "echo", "other's refusal", "garbage"],
)
def test_a_wrong_reply_is_an_error_and_the_next_request_begins_anew(answer: Answer, reason: str) -> None:
    controller, port = talking(answer)
    with pytest.raises(ReplyError, match=reason):
        controller.heartbeat()
    port.answer = beat
    assert controller.heartbeat().V2_V == 140.0
    assert [request.type for request in port.requests[2:]] == [Request.IDENTIFY, Request.HEARTBEAT]


def test_silence_is_a_fault_and_tells_what_was_asked() -> None:
    controller, _ = talking(lambda _: b"")
    with pytest.raises(LinkTimeout) as caught:
        controller.heartbeat()
    assert caught.value.context["command"] == "HEARTBEAT"
    assert caught.value.context["resource"] == "scripted"


def test_sequence_numbers_rise_and_wrap() -> None:
    controller, port = talking(beat)
    controller._sequence = 0xFFFD
    for _ in range(3):
        controller.heartbeat()
    assert [request.sequence for request in port.requests] == [0xFFFE, 0xFFFF, 0, 1]


@pytest.mark.parametrize(
    ("reason", "error"),
    [
        (Reason.FAULT_STANDS, InstrumentTripped),
        (Reason.NOT_ARMED, InstrumentRefused),
        (Reason.OUT_OF_ORDER, InstrumentRefused),
        (Reason.PULSE_TOO_SHORT, SetPointRefused),
        (200, InstrumentRefused),
    ],
)
def test_a_refusal_is_raised_with_its_reason(reason: int, error: type[Exception]) -> None:
    controller, _ = talking(lambda r: beat(r, type=NACK, payload=REFUSAL.pack(r.type, reason)))
    with pytest.raises(error, match=r"refuses|session") as refused:
        controller.enable()
    assert refused.type is error  # only a set point may be given up for another


def test_a_restarted_controller_gets_a_new_session() -> None:
    lost = REFUSAL.pack(Request.HEARTBEAT, Reason.OUT_OF_ORDER)
    controller, port = talking(lambda r: beat(r, type=NACK, payload=lost))
    with pytest.raises(InstrumentRefused, match="restarted"):
        controller.heartbeat()
    port.answer = beat
    controller.heartbeat()
    assert [request.type for request in port.requests] == [1, 6, 1, 6]


@pytest.mark.parametrize(("mode", "n1", "n2"), [(0, 551, 200), (0, 550, 202), (1, 550, 200), (9, 550, 200)])
def test_another_modulation_than_the_one_set_is_an_error(mode: int, n1: int, n2: int) -> None:
    """1000 counts per half period here, so 0.55 and 0.2 are exactly 550 and 200."""
    controller, _ = talking(lambda r: beat(r, payload=APPLIED.pack(mode, n1, n2)))
    with pytest.raises((ReadbackError, ReplyError)):
        controller.set_modulation(0.55, 0.2)


def test_another_heartbeat_period_than_the_one_set_is_an_error() -> None:
    controller, _ = talking(lambda r: beat(r, payload=ARM.pack(1999)))
    with pytest.raises(ReadbackError, match="1999 ms after it was set to 2000 ms"):
        controller.arm()


@pytest.mark.parametrize(
    "back",
    [
        (ROWS[0], replace(ROWS[1], D1=0.99)),
        (ROWS[0], replace(ROWS[1], power_W=1101.0)),
        ROWS[:1],
    ],
)
def test_another_table_than_the_one_loaded_is_an_error(back: tuple[TableRow, ...]) -> None:
    controller, _ = talking(lambda r: beat(r, payload=pack_table(0, back)))
    with pytest.raises(ReadbackError, match="table"):
        controller.load_table(ROWS)


def test_enable_and_disable_believe_the_telemetry_only() -> None:
    """The flags stay 0 (off), then 1 (on), whatever is acknowledged."""

    def always(flags: int) -> Answer:
        state = TELEMETRY.pack(flags, 0, 0, 0, 0.25, 140.0, 40.0, 50.0, 60.0, 25.0)
        return lambda r: beat(r, payload=state if r.type == Request.HEARTBEAT else b"")

    off, _ = talking(always(0))
    on, _ = talking(always(1))
    off.disable()
    on.enable()
    with pytest.raises(ReadbackError, match="off after it was switched on"):
        off.enable()
    with pytest.raises(ReadbackError, match="on after it was switched off"):
        on.disable()


def test_disable_is_tried_again_when_a_reply_is_lost() -> None:
    replies = iter([b"", b""])
    controller, port = talking(lambda r: next(replies, beat(r, payload=b"") if r.type == 5 else beat(r)))
    controller.disable()
    assert [request.type for request in port.requests].count(Request.DISABLE) == 3


@pytest.mark.parametrize(
    "identity",
    [b"", b"\x01", struct.pack("<HB", 0, 64) + b"a,b,c,d", struct.pack("<HB", 9, 64) + b"a,b", b"\xff" * 9],
)
def test_an_identity_that_is_none_is_refused(identity: bytes) -> None:
    script = [(encode(Frame(1, 1)), encode(Frame(1, 0x81, identity)))]
    with pytest.raises(ReplyError):
        Controller(ByteLink(ScriptedPort(script), "scripted")).identify()


@pytest.mark.parametrize(
    ("D1", "D2", "mode"), [(1.1, 0, "hybrid"), (0.5, -0.1, "hybrid"), (float("nan"), 0, "eps"), (1, 0, "SVM")]
)
def test_a_set_point_that_cannot_be_is_refused_before_anything_is_sent(
    D1: float, D2: float, mode: str
) -> None:
    controller, port = talking(beat)
    with pytest.raises(LimitError):
        controller.set_modulation(D1, D2, mode=mode)
    assert not port.requests


def test_a_fault_when_switching_on_is_raised(controller: Controller, plant: FakePlant) -> None:
    plant.broken = ("output undervoltage",)
    controller.arm()
    controller.set_modulation(0.7, 0.3)
    with pytest.raises(InstrumentTripped, match="output_undervoltage"):
        controller.enable()
    assert not plant.present.pwm


def test_a_table_is_read_back_in_whole_counts(controller: Controller) -> None:
    rows = (TableRow(power_W=200.0, D1=0.6, D2=0.3001), TableRow(power_W=1000.0, D1=0.9, D2=0.1))
    assert controller.load_table(rows) == (replace(rows[0], D2=0.3), rows[1])


@pytest.mark.parametrize(
    ("rows", "reason"),
    [
        (ROWS[:1], "1 rows"),
        (ROWS * 40, "80 rows"),
        (ROWS[::-1], "rise"),
        ((ROWS[0], replace(ROWS[1], D2=1.5)), "1100 W: D2"),
        ((ROWS[0], replace(ROWS[1], power_W=float("inf"))), "not a number"),
    ],
)
def test_a_table_that_cannot_be_is_refused(rows: tuple[TableRow, ...], reason: str) -> None:
    controller, port = talking(beat)
    with pytest.raises(LimitError, match=reason):
        controller.load_table(rows)
    assert not port.requests


# --- against the mock, over a pseudo-terminal ------------------------------------------------------


@pytest.fixture
def plant() -> FakePlant:
    return FakePlant()


@pytest.fixture
def controller(plant: FakePlant) -> Iterator[Controller]:
    mock = MockController(plant)
    with PtyServer(mock.handle, tick=mock.tick) as server, ByteLink.open(server.path, baud=115200) as link:
        yield Controller(link, heartbeat_s=2.0, timeout_s=10.0)


def test_sets_arms_enables_and_disables(controller: Controller, plant: FakePlant) -> None:
    applied = controller.set_modulation(0.70003, 0.3, mode="hybrid")
    assert (applied.D1, applied.D2) == (0.7, 0.3), "in whole counts of 1/2500"
    controller.arm()
    controller.enable()
    assert (plant.present.pwm, plant.present.D1, plant.present.D2, plant.mode) == (True, 0.7, 0.3, "hybrid")
    controller.disable()
    assert not plant.present.pwm
    assert controller.heartbeat().armed
    controller.disarm()
    assert not controller.heartbeat().armed


def test_beats_keep_the_pwm_on_and_their_absence_trips_it(controller: Controller, plant: FakePlant) -> None:
    """Four missed beats of 2 s: at 8 s all is well, past 8 s it is not."""
    controller.set_modulation(0.7, 0.3)
    controller.arm()
    controller.enable()
    for _ in range(10):
        plant.clock.sleep(8.0)
        assert controller.heartbeat().pwm_on
    plant.clock.sleep(8.01)
    telemetry = controller.heartbeat()
    assert (telemetry.pwm_on, telemetry.armed, telemetry.faults) == (False, False, ("heartbeat_lost",))
    with pytest.raises(InstrumentTripped):
        controller.enable()
    controller.arm()
    controller.enable()
    assert controller.heartbeat().faults == ()


def test_a_table_is_loaded_read_back_and_followed(controller: Controller, plant: FakePlant) -> None:
    loaded = controller.load_table(ROWS)
    assert loaded == ROWS
    controller.use_table()
    plant.set_load(on=True, power_W=560.0)
    assert controller.heartbeat().table_in_use
    assert (plant.present.D1, plant.present.D2) == (0.7, 0.15), "at 0.4 of the way from 200 W to 1100 W"
    controller.use_table(False)
    controller.set_modulation(0.5, 0.5)
    assert controller.heartbeat().D2 == 0.5


def test_two_programs_cannot_hold_the_controller(plant: FakePlant) -> None:
    with (
        PtyServer(MockController(plant).handle) as server,
        ByteLink.open(server.path),
        pytest.raises(LinkUnavailable, match="another program"),
    ):
        ByteLink.open(server.path)


def test_a_late_telemetry_is_not_taken_for_the_next(plant: FakePlant) -> None:
    """The first beat's reply is held back, and comes while the link is in quarantine, or before the next."""
    mock = MockController(plant)
    held: list[bytes] = []
    slow = iter([False, True])  # identification, beat

    def handle(chunk: bytes) -> bytes | None:
        reply = mock.handle(chunk) or b""
        if next(slow, False):
            held.append(reply)
            return None
        return (held.pop() if held else b"") + reply

    with PtyServer(handle) as server, ByteLink.open(server.path) as link:
        controller = Controller(link, timeout_s=0.5, lateness_s=0.5)
        controller.identify()
        with pytest.raises(LinkTimeout):
            controller.heartbeat()
        late = threading.Timer(0.05, lambda: server.send(held.pop() if held else b""))
        late.start()
        plant.present = replace(plant.present, load_V=139.0)
        assert controller.heartbeat().V2_V == 139.0
        late.join()
