"""Which N_ff, D_ff for this machine, and do they hold on the nonsmooth one?"""
