"""Which N_ff, D_ff suit this machine, and do they meet the specification?"""
