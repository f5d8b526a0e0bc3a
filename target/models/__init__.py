"""The box for simulators and viewers: one geometry, written as GLB, OBJ, SDF, MJCF and pictures of its faces."""
