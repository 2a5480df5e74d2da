"""The controller's protocol as it is described: driver and mock speak the document's bytes, tables are the code's."""

import re
from pathlib import Path

from drivers.controller import Controller, TableRow
from drivers.controller_messages import Reason, Request, fault_names, fault_word
from drivers.frames import Frame, decode, encode
from drivers.mocks.controller import MockController
from drivers.transport import ByteLink
from tests.drivers.fake_plant import FakePlant
from tests.drivers.scripted_port import ScriptedPort

DOCUMENT = Path(__file__).parents[2] / "docs" / "controller-protocol.md"
ROWS = (TableRow(power_W=200.0, D1=0.5, D2=0.25), TableRow(power_W=1100.0, D1=1.0, D2=0.0))


def documented() -> list[tuple[bytes, bytes]]:
    """The dialogue in the protocol's description: pairs of frames from host and controller."""
    said = re.findall(r"^(host|controller) +([0-9a-f ]+)$", DOCUMENT.read_text("utf-8"), re.MULTILINE)
    frames = [bytes.fromhex(text) for _, text in said]
    assert [who for who, _ in said] == ["host", "controller"] * (len(said) // 2)
    return list(zip(frames[::2], frames[1::2], strict=True))


def test_the_driver_speaks_the_documented_dialogue() -> None:
    """All of it but the last request, which the driver would not send."""
    link = ByteLink(ScriptedPort(documented()[:-1]), "scripted")
    controller = Controller(link, heartbeat_s=2.0)
    assert str(controller.identify()) == "d2ea virtual controller"
    applied = controller.set_modulation(0.55, 0.2)
    assert (applied.D1, applied.D2, applied.mode) == (0.55, 0.2, "hybrid")
    controller.arm()
    controller.enable()
    assert controller.load_table(ROWS) == ROWS
    controller.use_table()
    controller.disable()
    controller.disarm()
    controller.close()


def test_the_mock_speaks_the_documented_dialogue() -> None:
    mock = MockController(FakePlant(), counts=2500, dead_time=0.016)
    for request, reply in documented():
        assert mock.handle(request) == reply


def test_the_documented_tables_are_those_of_the_code() -> None:
    text = DOCUMENT.read_text("utf-8")
    for request in Request:
        assert f"| {request:02X} | {request.name} |" in text
    for reason in Reason:
        assert re.search(rf"\| {reason.value} \| \w", text), reason


def test_the_documented_beat_is_unpacked() -> None:
    """The telemetry of the document, in the words beside it."""
    script = documented()
    beat = Frame(2, Request.HEARTBEAT)
    telemetry = Frame(2, Request.HEARTBEAT | 0x80, decode(script[4][1][1:-1]).payload)
    link = ByteLink(ScriptedPort([script[0], (encode(beat), encode(telemetry))]), "scripted")
    told = Controller(link).heartbeat()
    assert (told.pwm_on, told.armed, told.table_in_use, told.faults) == (True, True, False, ())
    assert (told.D0, told.D1, told.D2, told.V2_V) == (0.25, 0.55, 0.2, 140.0)
    assert (told.T_heatsink_C, told.T_transformer_C, told.T_inductor_C, told.T_ambient_C) == (40, 50, 60, 25)


def test_fault_words_and_names() -> None:
    assert fault_names(0b1_0000_0011) == ("heartbeat_lost", "heatsink_overtemperature", "other")
    assert fault_names(1 << 12) == ("bit_12",)
    assert fault_word(("overcurrent", "gremlins", "goblins")) == 1 << 6 | 1 << 8
