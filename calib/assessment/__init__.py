"""Whether a calibration can be used, and why: rules, limits and the verdict."""
