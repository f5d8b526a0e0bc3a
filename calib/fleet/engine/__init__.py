"""Engines that run one call a robot: in this process, in processes of this machine, or on a cluster."""
