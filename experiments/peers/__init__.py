"""Other ways to the same answers, to compare ours with."""
