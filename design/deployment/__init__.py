"""A designed controller as code for a drive: C, FMU, structured text, MATLAB, profiles for a drive's cascade."""
