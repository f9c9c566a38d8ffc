"""Markup and figures of the report as a web page."""
