"""`python -m studies`: the studies and their questions."""

from importlib import import_module

from studies.catalogue import names

for name in names():
    module = import_module(f"studies.{name}.__main__")
    question = getattr(getattr(module, "STUDY", None), "question", None) or import_module(f"studies.{name}").__doc__
    print(f"{name:<26}{question}")
