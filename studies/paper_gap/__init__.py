"""Which effects leave what compensation left on the paper's table, and which experiment would tell."""
