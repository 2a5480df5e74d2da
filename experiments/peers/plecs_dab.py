"""The two-level DAB that an author of the paper simulated in PLECS under triple phase shift, as one of our converters.

Source of the circuit: the public repository XinzeLee/Fundamentals_of_AI_for_PE (DAB_TPS): 50 kHz, dead time 200 ns,
50 uH with 12 mOhm, transformer 1:1 with a saturable core, switches of 98 mOhm, body diodes of 3.3 V and 10 mOhm, 160 uF
at the output. Its D1 and D2 are widths of the pulses, its D0 the shift between their leading edges, in half periods.

Assumption: the core does not saturate and magnetizes by 10 mH; the switches, ideal in PLECS, have 20 pF, which a
current of some ten milliamperes swings within the dead time.
"""

from sim.parameters import (
    Capacitance,
    Conduction,
    Converter,
    Core,
    FullBridge,
    Inductor,
    Recovery,
    Switch,
    SwitchingEnergy,
    Transformer,
    Winding,
)

DEAD_TIME_S, FREQUENCY_HZ = 200e-9, 50e3
_NOTHING = SwitchingEnergy(
    energy_J=0.0, reference_V=200.0, reference_A=10.0, current_exponent=1.0, voltage_exponent=1.0
)
_AIR = Core(k=0.0, alpha=1.0, beta=2.0, area_m2=1e-4, volume_m3=1e-5, turns=32.0)


def plecs_dab() -> Converter:
    """The converter, fresh; points bring their own voltages.

    >>> plecs_dab().modulation
    'tps'
    """
    switch = Switch(
        part="ideal switch, 98 mOhm",
        synchronous=True,
        on=Conduction(threshold_V=0.0, resistance_Ohm=0.098),
        reverse=Conduction(threshold_V=3.3, resistance_Ohm=0.010),
        turn_off=_NOTHING,
        turn_on=_NOTHING,
        recovery=Recovery(charge_C=0.0, reference_A=10.0),
        capacitance=Capacitance(zero_bias_F=20e-12, junction_V=1e3, grading=0.5),
        thermal_K_per_W=1.0,
    )
    return Converter(
        name="two-level DAB, 200 V, 1 kW (PLECS)",
        V1_V=200.0,
        V2_V=200.0,
        rated_power_W=1000.0,
        frequency_Hz=FREQUENCY_HZ,
        dead_time_s=DEAD_TIME_S,
        modulation="tps",
        primary=FullBridge(switch=switch),
        secondary=FullBridge(switch=switch),
        inductor=Inductor(
            inductance_H=50e-6,
            winding=Winding(resistance_Ohm=0.012, ac_extra=0.0),
            core=_AIR,
            thermal_K_per_W=1.0,
        ),
        transformer=Transformer(
            turns_ratio=1.0,
            magnetizing_H=10e-3,
            winding=Winding(resistance_Ohm=0.0, ac_extra=0.0),
            core=_AIR,
            thermal_K_per_W=1.0,
        ),
        link_resistance_Ohm=0.0,
        secondary_delay_s=0.0,
        auxiliary_power_W=0.0,
        input_cable_Ohm=0.0,
        output_cable_Ohm=0.0,
        heatsink_K_per_W=1.0,
    )
