"""How much friction suppression does stability leave?"""
