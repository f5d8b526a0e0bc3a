"""AprilTag families: which modules of a tag are black, and their outline."""
