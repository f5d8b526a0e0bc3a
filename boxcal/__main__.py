"""``python -m boxcal``: all commands under one name."""
