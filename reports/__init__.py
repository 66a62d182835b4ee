"""Readable reports from plain results: HTML and PDF from one Markdown source, and the figures' style."""
