"""Uncertainty of a calibration: propagation, observability, cross-validation, the Cramer-Rao bound."""
