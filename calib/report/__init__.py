"""Reports that people read: one self-contained HTML page a robot, one for the fleet."""
