"""Planning of drives: where the next stops tell most, and which whole drive is enough."""
