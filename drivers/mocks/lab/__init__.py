"""The virtual lab: a converter, its surroundings and its analyzer that measure like hardware would.

It has physics of its own: nothing here comes from the simulator that later has to explain its readings,
but for the parameter objects, the modulation and the waveform solver (which circuit simulators vouch for).
Laws of temperature, switching, core and copper, thermal time constants and instrument errors are written
anew, and every part is off by its everyday spread, drawn by the seed.
"""
