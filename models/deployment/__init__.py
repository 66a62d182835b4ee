"""The law as a drive runs it: its coefficients from a controller.json, and its difference equations."""
