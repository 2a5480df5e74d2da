"""What happens to a bench when things go wrong: the parts of the fault survey."""
