"""Random axes of a simulator that shares no code with models/, and how well they are identified."""
