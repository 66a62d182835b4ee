"""Does the model reproduce the paper's response variation, and which tables are consistent with it?"""
