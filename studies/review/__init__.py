"""Does this report still follow from its inputs?"""
