"""Import: files of robots become observations, posted through the public client."""
