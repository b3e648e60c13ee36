"""What was observed: packed bits, intervals, measurements, and their time base. Pure."""
