"""What we decide for the machine: feedforward and friction compensation."""
