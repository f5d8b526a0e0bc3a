"""Recording of what is heard, into an MCAP file that a crash cannot spoil."""
