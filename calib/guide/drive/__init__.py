"""The drive so far: wheels, stands, pictures, and the stops that were taken."""
