"""Feedbacks of every structure: what a machine file states of them, and the one linear law that each of them is."""
