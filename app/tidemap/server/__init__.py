"""What a server process is made of."""
