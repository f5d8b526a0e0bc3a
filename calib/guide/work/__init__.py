"""Work that takes long, done beside the session so that it goes on listening."""
