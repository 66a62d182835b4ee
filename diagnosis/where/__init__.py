"""Where the records leave the model."""
