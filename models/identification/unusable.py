"""Records that their method can't use, which says nothing of the others: these keep what they gave."""

from __future__ import annotations


class UnusableError(ValueError):
    """A record that is read and recognised, and of which the fit comes to nothing; a sentence without the file's name.

    Beside others that were identified it is left out, and told.
    """
