"""Every register map passes one contract; a map that cannot be used says where and why."""

from importlib import resources

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.modbus_map import DecimalsRegister, MapError, ModbusMap, Register, load_map

MAPS = sorted(f.name.removesuffix(".toml") for f in (resources.files("drivers") / "maps").iterdir())
MODBUS_MAPS = [name for name in MAPS if name.startswith(("ea_", "riden_"))]
NEEDED = {"set_voltage", "set_current", "actual_voltage", "actual_current", "actual_power", "output"}


@pytest.fixture(params=MODBUS_MAPS)
def map(request: pytest.FixtureRequest) -> ModbusMap:
    return load_map(request.param)


def test_a_map_has_what_a_dc_device_needs(map: ModbusMap) -> None:
    assert set(map.registers) >= NEEDED
    assert "on" in map.flags
    assert all(map.registers[name].unit in ("V", "A", "W") for name in NEEDED - {"output"})


def test_no_two_registers_of_a_map_overlap(map: ModbusMap) -> None:
    places = [(r.space, r.address + k) for r in map.registers.values() for k in range(r.count)]
    assert len(places) == len(set(places))


def test_every_written_register_of_a_map_is_read_back_or_says_that_it_cannot_be(map: ModbusMap) -> None:
    unverified = {r.name for r in map.registers.values() if "w" in r.access and r.read_back == "none"}
    assert unverified <= {"acknowledge"}


def test_every_register_of_a_map_fits_one_request_and_survives_the_wire(map: ModbusMap) -> None:
    for register in map.registers.values():
        raw = "text" if register.type == "text" else 1
        words = register.encode(raw)
        assert len(words) == register.count <= 125
        assert register.decode(words) == raw


def test_alarms_of_a_map_do_not_share_a_pattern(map: ModbusMap) -> None:
    patterns = [(a.of, a.mask, a.equals) for a in map.alarms.values()]
    assert len(patterns) == len(set(patterns))


def test_ea_addresses_and_full_scales_are_those_of_the_register_list() -> None:
    for name in ("ea_psi9000", "ea_elr9000"):
        registers = load_map(name).registers
        assert [registers[f"set_{q}"].address for q in ("voltage", "current", "power")] == [500, 501, 502]
        assert [registers[f"actual_{q}"].address for q in ("voltage", "current", "power")] == [507, 508, 509]
        assert registers["set_power"].range == (0, 0xD0E5)  # 102 %
        assert registers["protect_power"].range == (0, 0xE147)  # 110 %


def test_word_order_is_obeyed() -> None:
    high = Register(name="x", address=0, type="f32")
    low = Register(name="x", address=0, type="f32", word_order="low_first")
    assert high.encode(500.0) == [0x43FA, 0x0000]  # IEEE 754 of 500.0 is 0x43FA0000
    assert low.decode([0x0000, 0x43FA]) == 500.0


def test_digits_may_stand_in_a_register_of_the_device() -> None:
    scaling = DecimalsRegister(kind="decimals_register", of="decimals", shift=4)
    assert scaling.per_count(lambda name: {"decimals": 0x233}[name]) == pytest.approx(1e-3, rel=1e-12)


@given(st.sampled_from(["u16", "i16", "u32", "i32"]), st.sampled_from(["high_first", "low_first"]), st.data())
def test_integers_survive_the_wire(kind: str, order: str, data: st.DataObject) -> None:
    bits, signed = int(kind[1:]), kind[0] == "i"
    raw = data.draw(st.integers(-(2 ** (bits - 1)) if signed else 0, 2 ** (bits - signed) - 1))
    register = Register.model_validate({"name": "x", "address": 0, "type": kind, "word_order": order})
    assert register.decode(register.encode(raw)) == raw


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("x = { address = 70000 }", "registers.x.address"),
        ("x = { address = 1, colour = 3 }", "registers.x.colour"),
        ('x = { address = 1, type = "text" }', "words is given for a text"),
        ('x = { space = "coil", address = 1 }', "a coil holds a bool"),
        ('x = { space = "input", address = 1, access = "rw" }', "cannot be written"),
        ('x = { address = 1, lowest = "nowhere" }', "nowhere"),
        ('x = { address = 1, requires = ["nowhere"] }', "nowhere"),
        ('x = { address = 1, read_back = "flag.nowhere" }', "nowhere"),
    ],
)
def test_a_wrong_map_names_file_and_field(tmp_path, line: str, says: str) -> None:
    text = (resources.files("drivers") / "maps" / "riden_rd60xx.toml").read_text("utf-8")
    path = tmp_path / "mine.toml"
    path.write_text(text.replace("[registers]", f"[registers]\n{line}", 1), encoding="utf-8")
    with pytest.raises(MapError, match=rf"mine\.toml.*{says}"):
        load_map(path)


def test_a_missing_map_lists_those_that_there_are_by_what_they_are_for() -> None:
    said = "there are ea_psi9000, riden_rd60xx for a supply; ea_elr9000 for a load. Name one"
    with pytest.raises(MapError, match=said):
        load_map("ea_psi8000")
