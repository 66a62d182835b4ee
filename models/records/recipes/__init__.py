"""Mappings of columns by file: rules, the TOML files that hold them, and recipes of usual logs as such files."""
