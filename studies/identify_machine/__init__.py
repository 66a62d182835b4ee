"""Which machine is this? From FRF, hysteresis and motion records to a machine file with uncertainties."""
