"""The report as a web page: markup, figures and the scripts that turn and slide them."""
