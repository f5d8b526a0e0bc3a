"""Frames taken between stops: poses on the wheels' own path, at times that an unknown clock offset shifts."""
