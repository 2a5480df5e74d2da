"""Effects that only scale, add to or replace named parameters of the converter: a table."""

from dataclasses import replace

from sim.effects.base import Effect, EffectParameter
from sim.effects.parameter_effect import (
    ParameterEffect,
    added,
    replaced,
    scaled,
    shortened_to_nothing_at_most,
)
from sim.prototype import prototype


def _parameter(
    name: str, unit: str, tolerance: float, prior: float, bounds: tuple[float, float], goes_by: str = ""
) -> tuple[EffectParameter]:
    lower, upper = bounds
    return (
        EffectParameter(
            name=name, unit=unit, tolerance=tolerance, prior=prior, lower=lower, upper=upper, goes_by=goes_by
        ),
    )


def _relative(
    tolerance: float, prior: float, bounds: tuple[float, float] = (-0.6, 2.0)
) -> tuple[EffectParameter]:
    return _parameter("relative_error", "1", tolerance, prior, bounds)


def _started(parameters: tuple[EffectParameter], values: tuple[float, ...]) -> tuple[EffectParameter]:
    """The parameter with values from which a search should start, since its effect is far from a line."""
    return (replace(parameters[0], starts=values),)


_FETS = ("primary.outer", "primary.switch", "secondary.switch")  # or IGBTs, where another converter has them
_SWITCHES = ("primary.outer", "primary.inner", "primary.switch", "secondary.switch")
_Lm = float(prototype().transformer.magnetizing_H)

SCALINGS: tuple[Effect, ...] = (
    ParameterEffect(
        name="link_resistance",
        stage="circuit",
        parameters=_parameter("resistance_Ohm", "Ohm", 0.003, 0.06, (0.0, 0.5), "input_resistance"),
        paths=("link_resistance_Ohm",),
        change=added,
        says="the ac link has more series resistance than modelled: winding, circuit board or connectors",
        check_on_bench="measure the ac link with four wires, warm, terminal to terminal",
    ),
    ParameterEffect(
        name="skin_effect",
        stage="circuit",
        parameters=_parameter("extra_at_fs", "1", 0.04, 0.5, (-0.03, 5.0)),
        paths=("inductor.winding.ac_extra", "transformer.winding.ac_extra"),
        change=added,
        law=0.15,
        of_eddies=True,
        says=(
            "the windings' resistance at the switching frequency is higher than modelled: skin and "
            "proximity effect"
        ),
        says_below="the windings' resistance rises less with frequency than modelled: finer strands, or fewer layers",
        check_on_bench=(
            "measure inductor and transformer with an impedance analyzer from dc to ten times the "
            "switching frequency"
        ),
    ),
    ParameterEffect(
        name="leakage_inductance",
        stage="circuit",
        parameters=_relative(0.01, 0.08, (-0.3, 0.3)),
        paths=("inductor.inductance_H",),
        change=scaled,
        thermometer="T_inductor_C",
        says="the link inductance is higher than its nominal value: choke, or the transformer's leakage beside it",
        says_below="the link inductance is lower than its nominal value: choke, air gap, or less leakage than counted",
        check_on_bench=(
            "make sure that the bench switched at the model's frequency; then measure the series inductance with "
            "the transformer in place, secondary shorted, at that frequency"
        ),
    ),
    ParameterEffect(
        name="inductor_saturation",
        stage="circuit",
        # it goes with the current squared: where the link carries most, a line leads nowhere
        parameters=_started(_parameter("relative_drop", "1", 0.01, 0.15, (0.0, 0.6)), (0.1, 0.25)),
        paths=("inductor.saturation",),
        change=added,
        law=0.1,
        # Assumption: uniform within what a parabola with the same small currents drops more there, d^2 / (1 - d)
        extrapolated=0.7,
        says="the link inductance falls with current: its core saturates, by that much at the model's saturation_A "
        "(15 A in the prototype)",
        check_on_bench="look at the link current's corners at full load with a current probe: are they pointed?",
    ),
    ParameterEffect(
        name="magnetizing_inductance",
        stage="circuit",
        parameters=(
            EffectParameter(
                name="inductance_H",
                unit="H",
                tolerance=0.1 * _Lm,
                prior=6e-3,
                lower=1e-3,
                upper=60e-3,
                off=_Lm,
                starts=(0.2 * _Lm, 0.3 * _Lm, 0.5 * _Lm),
                reciprocal=True,  # its current is
                goes_by="magnetizing",
            ),
        ),
        paths=("transformer.magnetizing_H",),
        change=replaced,
        law=0.05,
        thermometer="T_transformer_C",
        says="the magnetizing inductance is higher than modelled: less air gap in the core, or another grade",
        says_below="the magnetizing inductance is lower than modelled: an air gap in the core, or another grade",
        check_on_bench="measure the transformer's open-circuit inductance at working flux",
    ),
    ParameterEffect(
        name="dead_time",
        stage="circuit",
        parameters=_parameter("error_s", "s", 8e-9, 80e-9, (-300e-9, 600e-9)),
        paths=("dead_time_s",),
        change=shortened_to_nothing_at_most,
        law=0.05,
        says="the dead time at the gates is longer than set: drivers that switch on late, or another setting",
        says_below="the dead time at the gates is shorter than set: drivers that switch off late, or another setting",
        check_on_bench="measure period and both gate signals of one leg at the switches with an oscilloscope",
    ),
    ParameterEffect(
        name="gate_delay_skew",
        stage="circuit",
        parameters=_parameter("skew_s", "s", 8e-9, 60e-9, (-400e-9, 400e-9)),
        paths=("secondary_delay_s",),
        change=added,
        says=(
            "the secondary's gates come later than the primary's by more than modelled: driver or "
            "isolator delay"
        ),
        says_below=(
            "the primary's gates come later than the secondary's by more than modelled: "
            "driver or isolator delay"
        ),
        check_on_bench="measure the gates of S1 and Q1 against their commands with an oscilloscope",
    ),
    ParameterEffect(
        name="igbt_saturation_voltage",
        stage="semiconductors",
        parameters=_parameter("voltage_V", "V", 0.03, 0.3, (-0.5, 2.0)),
        paths=tuple(f"{s}.on.threshold_V" for s in _SWITCHES),
        change=added,
        junction=True,
        law=0.05,
        says="the IGBTs drop more than the datasheet's typical value: gate voltage, batch or ageing",
        says_below="the IGBTs drop less than the datasheet's typical value: batch, or a cautious datasheet",
        check_on_bench="measure the saturation voltage at load with a clamp probe, and the gate voltage",
    ),
    ParameterEffect(
        name="sic_on_resistance",
        stage="semiconductors",
        parameters=_relative(0.04, 0.4),
        paths=tuple(f"{s}.on.resistance_Ohm" for s in _SWITCHES),
        change=scaled,
        junction=False,
        law=0.05,
        says="the FETs' on-resistance is higher than the datasheet's typical value: gate voltage, batch or ageing",
        says_below="the FETs' on-resistance is lower than the datasheet's typical value: batch, or cooler than thought",
        check_on_bench=(
            "measure drain-source voltage at dc load current with the gate on, at working temperature"
        ),
    ),
    ParameterEffect(
        name="clamp_diode_drop",
        stage="semiconductors",
        parameters=_relative(0.03, 0.4),
        paths=("primary.clamp.on.threshold_V", "primary.clamp.on.resistance_Ohm"),
        change=scaled,
        law=0.05,
        says="the clamp diodes drop more than the datasheet's typical value",
        says_below="the clamp diodes drop less than the datasheet's typical value",
        check_on_bench="measure the clamp diodes' forward voltage at load current and working temperature",
    ),
    ParameterEffect(
        name="turn_off_energy_primary",
        stage="semiconductors",
        parameters=_relative(0.08, 0.7),
        paths=tuple(f"primary.{s}.turn_off.energy_J" for s in ("outer", "inner", "switch")),
        change=scaled,
        law=0.1,
        says=(
            "the primary switches lose more at turn-off than the datasheet scales to: gate resistor, "
            "stray inductance, tail current"
        ),
        says_below=(
            "the primary switches lose less at turn-off than the datasheet scales to: gate resistor, or a voltage "
            "far below that of the datasheet"
        ),
        check_on_bench=(
            "double-pulse test of the primary leg at the voltage that it switches, or change the gate resistor and "
            "re-measure"
        ),
    ),
    ParameterEffect(
        name="turn_off_energy_secondary",
        stage="semiconductors",
        parameters=_relative(0.08, 2.0, (-0.6, 20.0)),
        paths=("secondary.switch.turn_off.energy_J",),
        change=scaled,
        law=0.1,
        says=(
            "the secondary switches lose more at turn-off than the datasheet scales to: gate resistor, "
            "stray inductance"
        ),
        says_below=(
            "the secondary switches lose less at turn-off than the datasheet scales to: gate resistor, or a voltage "
            "far below that of the datasheet"
        ),
        check_on_bench="double-pulse test of the secondary leg, or change the gate resistor and re-measure",
    ),
    ParameterEffect(
        name="output_capacitance",
        stage="semiconductors",
        parameters=_started(_relative(0.06, 0.7), (-0.3, 0.3, 0.7)),  # edges lose zero voltage one by one
        paths=tuple(f"{s}.capacitance.zero_bias_F" for s in _FETS),
        change=scaled,
        law=0.1,
        says="the FETs' nodes have more capacitance than modelled: device, snubber or board",
        says_below="the FETs' nodes have less capacitance than modelled: device, or a snubber that is not there",
        check_on_bench="time the node's voltage slope in the dead time at a known current",
    ),
    ParameterEffect(
        name="reverse_recovery",
        stage="semiconductors",
        # A fast diode of the same maker (in APT40GF120JRD) recovers in 70 ns, at most 85 ns, from 18 A, at most 30 A,
        # when cold, 29 A, at most 40 A, when hot: 1.7 to 2.0 times the typical charge. Taken as two sigma that is 40 %;
        # 20 % of it each part has for itself.
        parameters=_relative(0.35, 1.5, (-0.8, 15.0)),
        together=True,
        paths=tuple(f"{d}.recovery.charge_C" for d in ("primary.clamp", *_FETS)),
        change=scaled,
        law=0.15,
        says="diodes lose more at hard commutation than modelled: recovery charge",
        says_below="diodes lose less at hard commutation than modelled: recovery charge",
        check_on_bench="look at the turn-on current's overshoot at a hard edge, cold and warm",
    ),
    ParameterEffect(
        name="core_loss_transformer",
        stage="magnetics",
        parameters=_relative(0.07, 0.6, (-0.6, 6.0)),
        paths=("transformer.core.k",),
        change=scaled,
        law=0.1,
        core_of="transformer",
        says=(
            "the transformer's core loses more than its material data say: grade, gap, dc bias or temperature"
        ),
        says_below="the transformer's core loses less than its material data say: a better grade, or temperature",
        check_on_bench="measure no-load power at rated voltage, and the core's temperature",
    ),
    ParameterEffect(
        name="core_loss_inductor",
        stage="magnetics",
        parameters=_relative(0.07, 1.0, (-0.6, 6.0)),
        paths=("inductor.core.k",),
        change=scaled,
        law=0.1,
        core_of="inductor",
        says="the inductor's core loses more than its material data say: fringing at the gap, grade, dc bias",
        says_below="the inductor's core loses less than its material data say: a better grade, or temperature",
        check_on_bench="compare the inductor's temperature at equal rms current and different ripple",
    ),
    ParameterEffect(
        name="auxiliary_power",
        stage="supply, wiring",
        parameters=_parameter("power_W", "W", 0.1, 3.0, (0.0, 50.0), "power"),
        paths=("auxiliary_power_W",),
        change=added,
        law=0.01,
        says="gate drivers, fan or control draw constant power from the input while the bridges switch",
        check_on_bench="feed the gate drivers and the fan from a supply of their own, and measure that",
    ),
    ParameterEffect(
        name="cable_resistance_input",
        stage="supply, wiring",
        parameters=_parameter("resistance_Ohm", "Ohm", 0.003, 0.08, (0.0, 1.0), "input_resistance"),
        paths=("input_cable_Ohm",),
        change=added,
        says="resistance between the analyzer's input terminals and the dc link: cable, fuse, contactor",
        check_on_bench="measure the voltage from the analyzer's terminals to the dc link at full current",
    ),
    ParameterEffect(
        name="cable_resistance_output",
        stage="supply, wiring",
        parameters=_parameter("resistance_Ohm", "Ohm", 0.0008, 0.02, (0.0, 0.3), "output_resistance"),
        paths=("output_cable_Ohm",),
        change=added,
        says=(
            "resistance between the output capacitors and the analyzer's output terminals: cable, "
            "shunt, contactor"
        ),
        check_on_bench=(
            "measure the voltage from the output capacitors to the analyzer's terminals at full current"
        ),
    ),
    ParameterEffect(
        name="thermal_resistance",
        stage="thermal, time",
        parameters=_relative(0.06, 0.6),
        paths=("heatsink_K_per_W",),
        change=scaled,
        law=0.05,
        says="the heatsink runs hotter for its loss than modelled: fan, dust, mounting",
        says_below="the heatsink runs cooler for its loss than modelled: air flow, or a sensor far from the parts",
        check_on_bench="compare the heatsink's temperature with its loss at steady state; look at the fan",
    ),
)
