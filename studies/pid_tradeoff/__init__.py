"""How much friction suppression does the stability margin allow?"""
