"""The parts of the simulator's benchmark: speed, agreement with other solvers, other people's points, load steps."""
