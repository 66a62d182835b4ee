"""Modes from a frequency response: the model of a response, its fit at one order, and which order it is."""
