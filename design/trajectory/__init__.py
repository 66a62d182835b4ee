"""x_T* by optimal control on the smoothed model, and the compensator that carries the friction's state."""
