"""Logs as text: encoding, layout and names are recognised, and the numbers read in chunks."""
