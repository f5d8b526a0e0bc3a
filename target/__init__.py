"""The landmark box: its geometry, tags, printable sheets and pictures of it."""
