"""SCPI: parsing replies, and attributing each to its query or to none."""

import contextlib
import math
import struct
import threading

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import InstrumentError, InstrumentRefused, LinkLost, LinkTimeout, ReplyError
from drivers.mocks.wire import PtyServer
from drivers.reading import Quality
from drivers.scpi import (
    QueuedError,
    ScpiLink,
    parse_error,
    parse_floats,
    parse_identity,
    parse_measured,
    parse_number,
    parse_numbers,
    parse_register,
    parse_setting,
    strip_header,
)
from drivers.transport import ByteLink
from tests.drivers.scripted_port import ScriptedPort, dialogue

SOON_S = 0.05


def scripted(text: str, timeout_s: float = 5.0) -> ScpiLink:
    port = ScriptedPort(dialogue(text))
    return ScpiLink(ByteLink(port, "scripted"), timeout_s=timeout_s, lateness_s=SOON_S, terminator=b"\r\n")


# --- parsing ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "value"),
    [("103.79E+00", 103.79), ("-1.23456E-03", -1.23456e-3), ("15", 15.0), ("500.0E-03", 0.5), (" 0.5 ", 0.5)],
)
def test_numbers_are_good(text: str, value: float) -> None:
    number = parse_number(text)
    assert (number.value, number.quality) == (value, Quality.GOOD)


@pytest.mark.parametrize("text", ["NAN", "nan", "9.91E+37", "9.91000E+37"])
def test_no_data_is_no_number(text: str) -> None:
    number = parse_number(text)
    assert number.quality is Quality.NO_DATA
    assert math.isnan(number.value)


@pytest.mark.parametrize("text", ["INF", "-INF", "9.9E+37", "-9.90000E+37"])
def test_over_range_is_no_number(text: str) -> None:
    assert parse_number(text).quality is Quality.OVERRANGE


@pytest.mark.parametrize("text", ["", "3.0012E", "3.0012E+0", "1,2", "0x10", "nano", "1.2.3", "E+01", "1_0"])
def test_what_is_no_number_is_refused(text: str) -> None:
    """A number cut short in transit ends in fewer than two digits of exponent."""
    with pytest.raises(ReplyError):
        parse_number(text)


def test_finite_sentinels_of_float_blocks_are_not_numbers() -> None:
    block = struct.pack(">f", 1.5) + bytes.fromhex("7E951BEE") + bytes.fromhex("7E94F56A")
    assert [n.quality for n in parse_floats(block)] == [Quality.GOOD, Quality.NO_DATA, Quality.OVERRANGE]
    assert parse_floats(block)[0].value == 1.5


def test_headers_are_stripped_and_data_is_not() -> None:
    assert strip_header(":NUM:NORM:VAL 1.0E+00,NAN") == "1.0E+00,NAN"
    assert strip_header("YOKOGAWA,760304-40-MV,0,F5.01") == "YOKOGAWA,760304-40-MV,0,F5.01"


def test_error_queue_entries() -> None:
    assert parse_error('113,"Undefined Header"') == QueuedError(113, "Undefined Header")
    with pytest.raises(ReplyError):
        parse_error("Undefined Header")


PARSERS = (parse_number, parse_numbers, parse_setting, parse_register, parse_error, parse_identity)


@given(text=st.text(max_size=60) | st.text('0123456789.,+-EeNAIF":# ', max_size=60))
def test_any_text_is_a_value_or_a_typed_error(text: str) -> None:
    for parse in PARSERS:
        with contextlib.suppress(ReplyError):
            parse(strip_header(text))


@given(block=st.binary(max_size=64))
def test_any_block_is_numbers_or_a_typed_error(block: bytes) -> None:
    try:
        numbers = parse_floats(block)
    except ReplyError:
        assert not block or len(block) % 4
    else:
        assert all(number.quality is not Quality.GOOD or math.isfinite(number.value) for number in numbers)


@given(reply=st.binary(max_size=80))
def test_any_reply_is_a_value_or_a_typed_error(reply: bytes) -> None:
    """Over the link itself, as text and as a block; there is no wait for more than the reply."""

    def answering() -> ScpiLink:
        return ScpiLink(ByteLink(ScriptedPort([(b"Q?\n", reply)]), "scripted"))

    with contextlib.suppress(InstrumentError):
        answering().query("Q?", parse_numbers, timeout_s=0.001)
    with contextlib.suppress(InstrumentError):
        answering().query_block("Q?", parse_floats, timeout_s=0.001)


# --- exchanges --------------------------------------------------------------------------------------


def test_a_command_is_checked_against_the_error_queue() -> None:
    scpi = scripted(
        """
        > :RATE 500MS
        > :STATUS:ERROR?
        < 0,"No error"
        > :RATTE 500MS
        > :STATUS:ERROR?
        < 113,"Undefined Header"
        > :STATUS:ERROR?
        < 0,"No error"
        """
    )
    scpi.command(":RATE 500MS")
    with pytest.raises(InstrumentRefused, match='113 "Undefined Header"'):
        scpi.command(":RATTE 500MS")


def test_an_error_queue_without_an_end_is_noticed() -> None:
    port = ScriptedPort([(b":STATUS:ERROR?\n", b'113,"Undefined Header"\r\n')] * 40)
    with pytest.raises(ReplyError, match="no end"):
        ScpiLink(ByteLink(port, "scripted")).errors()


def test_a_block_is_read_by_its_length_although_it_holds_line_ends() -> None:
    block = struct.pack(">f", 1.0) + b"\n\r\n#"
    script = [(b":NUMERIC:NORMAL:VALUE?\n", b":NUMERIC:NORMAL:VALUE #40008" + block + b"\r\n")]
    scpi = ScpiLink(ByteLink(ScriptedPort(script), "scripted"))
    assert scpi.query_block(":NUMERIC:NORMAL:VALUE?", bytes) == block


def test_a_reply_that_repeats_the_query_is_an_echo() -> None:
    scpi = scripted("> :RATE?\n< :RATE?\n< 500.0E-03")
    with pytest.raises(ReplyError, match="echo"):
        scpi.query(":RATE?", parse_setting)


def test_bytes_before_the_query_are_not_its_reply() -> None:
    scpi = scripted("> :RATE 1S\n< garbage\n> :RATE?\n< 1.000E+00")
    scpi.write(":RATE 1S")
    assert scpi.query(":RATE?", parse_setting) == 1.0


def test_silence_is_a_timeout_with_its_context() -> None:
    with pytest.raises(LinkTimeout) as caught:
        scripted("> :HARMONICS:ORDER?", timeout_s=SOON_S).query(":HARMONICS:ORDER?", parse_setting)
    assert caught.value.context["command"] == ":HARMONICS:ORDER?"
    assert caught.value.context["resource"] == "scripted"
    assert "elapsed_s" in caught.value.context


@pytest.mark.parametrize("reply", ["1.0E+0", "not a number", "\x80\x81"])
def test_after_a_reply_that_makes_no_sense_the_link_is_resynchronised(reply: str) -> None:
    scpi = scripted(f"> :RATE?\n< {reply}\n> *CLS\n> *OPC?\n< 1\n> :RATE?\n< 1.000E+00")
    with pytest.raises(ReplyError):
        scpi.query(":RATE?", parse_setting)
    assert scpi.query(":RATE?", parse_setting) == 1.0


def test_silence_at_the_first_contact_says_what_was_asked() -> None:
    with pytest.raises(LinkTimeout, match=r"command='\*OPC\?'"):
        scripted("> *CLS\n> *OPC?", SOON_S).resynchronise()


@pytest.mark.parametrize(("word", "said"), [("+OVLD", "is not a number"), ("30.1", "exponent is missing")])
def test_a_measured_value_that_is_none_is_refused_with_the_reason(word: str, said: str) -> None:
    with pytest.raises(ReplyError, match=said):
        parse_measured(f"3.0004E+02,{word}")


def test_a_link_stays_in_doubt_until_it_is_resynchronised() -> None:
    scpi = scripted("> :RATE?\n> *CLS\n> *OPC?\n< 2\n> *CLS\n> *OPC?\n< 1\n> :RATE?\n< 1.000E+00", SOON_S)
    with pytest.raises(LinkTimeout):
        scpi.query(":RATE?", parse_setting)
    with pytest.raises(ReplyError, match="OPC"):
        scpi.query(":RATE?", parse_setting)
    assert scpi.query(":RATE?", parse_setting) == 1.0


class SlowOnce:
    """Answers each query with the number in it, in order; the first answer is held until it is let go."""

    def __init__(self) -> None:
        self.server = PtyServer(self.handle)
        self.held: list[bytes] = []
        self._first = True

    def handle(self, chunk: bytes) -> bytes | None:
        queries = [line[:-1] for line in chunk.split() if line.endswith(b"?")]
        replies = b"".join((b"1" if query == b"*OPC" else query) + b"\r\n" for query in queries)
        if self._first:
            self._first = False
            self.held.append(replies)
            return None
        return self.late_reply() + replies

    def late_reply(self) -> bytes:
        return self.held.pop() if self.held else b""


def test_a_late_reply_is_not_the_answer_to_the_next_query() -> None:
    """Query 11 is answered while the link is in quarantine; query 22 must get 22."""
    instrument = SlowOnce()
    with instrument.server as server, ByteLink.open(server.path) as link:
        scpi = ScpiLink(link, timeout_s=5.0, lateness_s=0.5)
        with pytest.raises(LinkTimeout):
            scpi.query("11?", parse_setting, SOON_S)
        answer = threading.Timer(0.05, lambda: server.send(instrument.late_reply()))
        answer.start()
        assert scpi.query("22?", parse_setting) == 22.0
        answer.join()


def test_a_hang_up_is_link_lost_with_its_context() -> None:
    server = PtyServer(lambda chunk: chunk).start()
    with ByteLink.open(server.path) as link:
        server.stop()
        with pytest.raises(LinkLost) as caught:
            ScpiLink(link).query("*IDN?", parse_identity)
        assert caught.value.context["resource"] == link.resource
