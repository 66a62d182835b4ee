"""A commented machine file to begin with, from ten answers."""
