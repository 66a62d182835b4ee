"""Sealed cases on machines drawn at random, each with its own experiment, by an integrator for any number of modes.

Nothing of models, design or diagnosis is imported here.
"""
