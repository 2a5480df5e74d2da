"""The parts of the experiment on adaptive campaigns."""
