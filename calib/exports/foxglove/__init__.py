"""Results as Foxglove messages in an MCAP file."""
