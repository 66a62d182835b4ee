"""Machine files, and how one is read."""
