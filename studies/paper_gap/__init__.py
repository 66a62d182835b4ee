"""Which effects explain the dispersion left on the paper's table, and which experiment would discriminate?"""
