"""The box for simulators and viewers: one geometry, written as GLB, OBJ, SDF, MJCF and images of its faces."""
