"""The PID at the edge of stability: goal, program, rounds, certificate."""
