"""Tables as files hold them: names, columns, units, whatever the format; what is too large is refused."""
