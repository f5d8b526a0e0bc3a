"""The command ``robot-history``: what the store of a fleet says over time."""
