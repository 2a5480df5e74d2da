"""Names what the simulation gets wrong: from a measurement table to a verdict with evidence.

The order of reading: :mod:`observations` (what was measured, as one vector), :mod:`signatures` (how each effect and
each everyday spread would move that vector), :mod:`usable` (what of it is gone by), :mod:`noise`, :mod:`covariance`,
:mod:`evidence` (every hypothesis with its probability), :mod:`verdict`, :mod:`gain`, :mod:`next_measurement`, and
:mod:`diagnose` that runs them.
"""
