"""The blind trial: its sealer, its guards, its rules."""
