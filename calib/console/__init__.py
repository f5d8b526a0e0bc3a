"""Terminal output: tables, verdicts, progress."""
