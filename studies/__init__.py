"""One question each; `python -m studies.NAME` answers it."""
