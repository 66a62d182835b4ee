"""What a model may leave out: one file a family of effects, each with its law, its priors and its place in the loop."""
