"""How two calibrations differ, and how far one is from a simulated robot's truth."""
