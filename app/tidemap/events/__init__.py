"""What happened, told to whoever listens: a hint, the rows are the truth."""
