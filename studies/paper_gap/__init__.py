"""Is the dispersion left on the paper's table due to the compensator's design, a wrong parameter or an effect?"""
