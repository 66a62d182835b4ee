"""What proposes an effect: each detector looks in its own way at what a model leaves."""
