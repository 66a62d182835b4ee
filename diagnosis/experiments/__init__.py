"""What to record next, and what records can tell apart."""
