"""Measured signals: the record, how files name its columns, reading and checking."""
