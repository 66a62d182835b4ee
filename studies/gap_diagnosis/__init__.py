"""Where does the real machine deviate from its model, which effect causes it, how much of the gap does it close?"""
