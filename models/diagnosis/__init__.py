"""Names what the simulation gets wrong: from a measurement table to a verdict with evidence.

In the order of a run: :mod:`observations` (the table as one vector), :mod:`usable` (which readings count),
:mod:`signatures` (how each effect and each everyday spread would move them), :mod:`noise`, :mod:`covariance` and
:mod:`setting` (both fitted to the readings), :mod:`hypotheses`, :mod:`search` and :mod:`refinery` (what explains the
readings), :mod:`evidence` (with which probability), :mod:`verdict`, and then :mod:`extension`, :mod:`gain` and
:mod:`next_measurement`. :mod:`diagnose` runs them.
"""
