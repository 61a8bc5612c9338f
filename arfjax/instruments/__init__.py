"""What an instrument would have read."""
