"""Foreign effects: what a lab can have that no catalogue of the simulator contains.

A diagnosis that knows its catalogue only must call them unknown. Each family is one class with a size, in one of
the files here, and one entry in :mod:`drivers.mocks.lab.foreign.families`.
"""
