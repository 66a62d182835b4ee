"""Is this report still reproducible from its inputs?"""
