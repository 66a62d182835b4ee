"""How far a verdict on a design holds: over dither and pasts of the friction, over long moves, over its range."""
