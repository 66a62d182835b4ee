"""Does the model show what the paper shows, and which tables could the paper's be?"""
