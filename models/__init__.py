"""What the machine is: parameters with their sources, plant, rolling friction, controller, simulator and its oracle."""
