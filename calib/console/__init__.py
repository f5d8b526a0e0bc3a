"""What the terminal shows: tables, verdicts, progress."""
