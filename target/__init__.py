"""The landmark box: its geometry, tags, printable sheets and images of it."""
