"""Blind trials: virtual labs with something hidden, diagnosed without being told, and scored."""
