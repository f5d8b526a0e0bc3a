"""A simulated robot that is driven by hand and heard over the network like a real one."""
