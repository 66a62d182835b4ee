"""The nonsmooth machine over time: the simulator, its compiled loops, and the oracle."""
