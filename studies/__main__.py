"""`python -m studies`: the studies and their questions; with --names the names alone of those that write results."""

from studies.interrupt import supervise

if __name__ == "__main__":
    supervise()  # before anything that takes time is imported

import sys
from importlib import import_module

from studies.catalogue import every, names

if sys.argv[1:] == ["--names"]:
    print("\n".join(every()))
    sys.exit()
for name in names():
    module = import_module(f"studies.{name}.__main__")
    question = getattr(getattr(module, "STUDY", None), "question", None) or import_module(f"studies.{name}").__doc__
    print(f"{name:<26}{question}")
