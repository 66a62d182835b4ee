"""What to record next, and which effects records can distinguish."""
