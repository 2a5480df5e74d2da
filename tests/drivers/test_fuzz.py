"""Whatever a wire brings: a value, or a typed error, and nothing else."""

import math
import tomllib

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from pymodbus.framer import FramerType

from drivers.controller import Controller
from drivers.errors import InstrumentError, ReplyError
from drivers.frames import Frame, decode, encode
from drivers.mocks.controller import MockController
from drivers.mocks.faults import FaultFile
from drivers.mocks.modbus_dc import MockSupply
from drivers.mocks.scpi_analyzer import ScpiAnalyzer
from drivers.modbus_link import ModbusLink
from drivers.modbus_map import MapError, Space, load_map
from drivers.reading import Quality
from drivers.scpi import (
    ScpiLink,
    parse_error,
    parse_floats,
    parse_identity,
    parse_measured,
    parse_numbers,
    parse_register,
    parse_setting,
)
from drivers.transport import ByteLink
from tests.drivers.fake_dc_plant import FakeDcPlant
from tests.drivers.fake_plant import FakePlant

NO_TIME = 1e-4  # a reply is there, or it never comes
LIKE_NUMBERS = st.text("0123456789.,+-EeNnAaIiFf \"'#:\r\n", max_size=40)
TEXTS = st.one_of(st.text(max_size=40), LIKE_NUMBERS)
RUNS = settings(max_examples=60, deadline=None)


class Answering:
    """A port that answers every write with the same bytes."""

    def __init__(self, reply: bytes) -> None:
        self._reply, self._waiting = reply, b""

    @property
    def in_waiting(self) -> int:
        return len(self._waiting)

    def read(self, size: int = 1, /) -> bytes:
        data, self._waiting = self._waiting[:size], self._waiting[size:]
        return data

    def write(self, data: bytes, /) -> int:
        self._waiting = self._reply
        return len(data)

    def close(self) -> None: ...


@example(text="0\x1f")  # white space to str.strip, not to int
@given(text=TEXTS)
def test_scpi_parsers_give_a_value_or_a_reply_error(text: str) -> None:
    parsers = (parse_numbers, parse_measured, parse_setting, parse_register, parse_error, parse_identity)
    for parse in parsers:
        try:
            parse(text)  # type: ignore[operator]
        except ReplyError:
            continue


@given(text=LIKE_NUMBERS)
def test_a_number_that_is_no_measurement_is_never_called_good(text: str) -> None:
    try:
        numbers = parse_measured(text)
    except ReplyError:
        return
    for number in numbers:
        usable = math.isfinite(number.value) and abs(number.value) < 9e37
        assert usable == (number.quality is Quality.GOOD) or abs(number.value) > 9e37


@given(block=st.binary(max_size=40))
def test_float_blocks(block: bytes) -> None:
    try:
        numbers = parse_floats(block)
    except ReplyError:
        assert not block or len(block) % 4
        return
    assert len(numbers) == len(block) // 4


@RUNS
@given(reply=st.binary(max_size=60))
def test_a_scpi_query_gives_text_or_an_instrument_error(reply: bytes) -> None:
    link = ScpiLink(ByteLink(Answering(reply), "fuzz"), timeout_s=NO_TIME, lateness_s=NO_TIME)
    for ask in (
        lambda: link.query("*IDN?", str),
        lambda: link.query_block("VALUE?", parse_floats),
        link.errors,
    ):
        try:
            ask()
        except InstrumentError:
            continue


@RUNS
@given(
    reply=st.one_of(st.binary(max_size=40), st.binary(max_size=8).map(lambda tail: b"\x01\x03" + tail)),
    framer=st.sampled_from([FramerType.RTU, FramerType.SOCKET]),
)
def test_a_modbus_reply_gives_registers_or_an_instrument_error(reply: bytes, framer: FramerType) -> None:
    link = ModbusLink(
        lambda: ByteLink(Answering(reply), "fuzz"), framer, timeout_s=NO_TIME, longest_lateness_s=NO_TIME
    )
    try:
        values = link.read(1, Space.HOLDING, 507, 1)
    except InstrumentError:
        return
    assert len(values) == 1
    assert 0 <= values[0] <= 0xFFFF


@RUNS
@given(
    reply=st.one_of(
        st.binary(max_size=60),
        st.builds(
            lambda sequence, type_, payload: encode(Frame(sequence, type_, payload)),
            st.integers(0, 3), st.integers(0, 255), st.binary(max_size=60),
        ),
    )
)  # fmt: skip
def test_a_controller_reply_gives_telemetry_or_an_instrument_error(reply: bytes) -> None:
    controller = Controller(ByteLink(Answering(reply), "fuzz"), timeout_s=NO_TIME, lateness_s=NO_TIME)
    for ask in (controller.identify, controller.heartbeat, controller.read_table):
        try:
            ask()
        except InstrumentError:
            continue


@given(coded=st.binary(max_size=60))
def test_frames(coded: bytes) -> None:
    try:
        decode(coded)
    except ReplyError:
        return


@RUNS
@given(chunk=st.binary(max_size=80))
def test_no_mock_falls_over_what_a_client_sends(chunk: bytes) -> None:
    plant = FakePlant()
    ScpiAnalyzer(plant).handle(chunk + b"\n")
    MockController(plant).handle(b"\0" + chunk + b"\0")
    MockSupply(FakeDcPlant(), unit=0).answer(0, chunk)


@RUNS
@given(
    content=st.one_of(st.binary(max_size=60), st.text('[]="aeiklmnrstu_ \n0123', max_size=60).map(str.encode))
)
def test_a_register_map_is_one_or_a_map_error(
    tmp_path_factory: pytest.TempPathFactory, content: bytes
) -> None:
    file = tmp_path_factory.mktemp("maps") / "any.toml"
    file.write_bytes(content)
    with pytest.raises(MapError, match=r"any\.toml"):
        load_map(file)


@RUNS
@given(text=st.text("fault[]=\"' \n0123456789.-#abcdeklnrsuy_", max_size=80))
def test_a_file_of_faults_is_one_or_a_value_error(text: str) -> None:
    try:
        FaultFile.model_validate(tomllib.loads(text))
    except ValueError:  # of TOML, or of what it says
        return
