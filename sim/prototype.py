"""The 2-kW NPC dual-active-bridge prototype of Li et al., D2EA, Table II, returned fresh.

Table II gives voltages, power, frequency, dead time, parts, turns ratio and inductance. It gives no
core, winding or cooling: those below are one plausible design, each marked ``Assumption``.
"""

from sim.datasheet import load_diode, load_switch
from sim.parameters import Converter, Core, FullBridge, Inductor, NpcBridge, Transformer, Winding
from sim.voltage_loop import VoltageLoop

# Assumption: a power ferrite near 100 degC, 57 kW/m3 at 25 kHz and 0.2 T, 375 kW/m3 at 100 kHz and 0.2 T.
_FERRITE = {"k": 3.9, "alpha": 1.36, "beta": 2.6}


def prototype() -> Converter:
    """The paper's converter with datasheet values.

    >>> converter = prototype()
    >>> converter.V1_V, converter.V2_V, converter.inductor.inductance_H
    (300.0, 140.0, 0.000236)
    """
    return Converter(
        name="NPC-DAB prototype, 2 kW",
        V1_V=300.0,  # Table II
        V2_V=140.0,  # Table II
        rated_power_W=2000.0,  # Table II
        frequency_Hz=20e3,  # Table II
        dead_time_s=400e-9,  # Table II
        modulation="hybrid",  # the paper's
        primary=NpcBridge(
            outer=load_switch("UF3C065030K4S"),  # Assumption: the SiC FETs are the outer switches
            inner=load_switch("IKW40N65ES5"),  # Assumption: the IGBTs are the inner switches
            clamp=load_diode("APT30DQ60BG"),
        ),
        secondary=FullBridge(switch=load_switch("UF3C065030K4S")),
        inductor=Inductor(
            inductance_H=236e-6,  # Table II
            winding=Winding(resistance_Ohm=0.045, ac_extra=0.10),  # Assumption: 30 turns of litz
            core=Core(**_FERRITE, area_m2=354e-6, volume_m3=43.5e-6, turns=30.0),  # Assumption: E55/28/21
            thermal_K_per_W=7.0,  # Assumption: winding in still air
        ),
        transformer=Transformer(
            turns_ratio=2.0,  # Table II
            magnetizing_H=12e-3,  # Assumption: ungapped E65/32/27 with 36 turns
            winding=Winding(resistance_Ohm=0.060, ac_extra=0.15),  # Assumption: both windings, referred
            core=Core(**_FERRITE, area_m2=535e-6, volume_m3=78.7e-6, turns=36.0),  # Assumption: E65/32/27
            thermal_K_per_W=5.0,  # Assumption
        ),
        link_resistance_Ohm=0.005,  # Assumption: circuit board and connectors
        secondary_delay_s=0.0,  # both bridges' gate drivers alike
        auxiliary_power_W=0.0,  # Assumption: gate drivers and control are fed from elsewhere
        input_cable_Ohm=0.0,  # the analyzer senses at the terminals
        output_cable_Ohm=0.0,  # the analyzer senses at the terminals
        heatsink_K_per_W=1.0,  # Assumption: one heatsink with a small fan for all semiconductors
    )


def prototype_voltage_loop() -> VoltageLoop:
    """The loop around the output voltage; the paper gives neither capacitor nor gains.

    Assumption: the crossover is 900 Hz where the phase acts most, n V1 / (2 fs Lk) = 64 A per unit: the delay of one
    and a half periods takes 24 degrees there, the PI's zero at a fifth of it 11. The capacitor is so large that a load
    step of half the rated power, 7.1 A, moves V2 by about 1 % in the time that the loop needs, 1 / (2 pi 900 Hz).
    """
    return VoltageLoop(
        capacitance_F=1.0e-3,  # Assumption: 7.1 A * 177 us / 1.4 V = 0.9 mF
        proportional_per_V=0.088,  # Assumption: 2 pi 900 Hz * 1 mF / 64 A
        integral_per_V_s=100.0,  # Assumption: zero at 180 Hz
        load_filter_s=100e-6,  # Assumption: two switching periods
    )
