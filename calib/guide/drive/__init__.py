"""The drive so far: wheels, stands, images, and the stops that were taken."""
