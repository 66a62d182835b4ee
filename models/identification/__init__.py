"""From measured records to the numbers of a machine, each with its uncertainty."""
