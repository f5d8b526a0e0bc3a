"""How sure a calibration is: propagation, observability, cross-validation, the Cramer-Rao bound."""
