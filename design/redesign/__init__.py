"""Another design for a machine that is known better now: what it promises, and whether it takes the old one's place."""
