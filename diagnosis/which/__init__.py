"""Which effect: scan, forward selection, shares."""
