"""Friction elements, and what acts beside them, from a record by inverse dynamics."""
