"""What happened, published to every listener: a hint, the rows are the truth."""
