"""Makes sealed cases with a simulator of its own: nothing of models, design or diagnosis is imported here."""
