"""Tables in binary containers, one module a format; what a file states is checked before it is read."""
