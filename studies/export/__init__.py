"""The same controller as C, FMU, structured text and MATLAB, and the proof that it is the same."""
