"""Where does the real machine leave the model, which effect causes it, how far does the gap shrink?"""
