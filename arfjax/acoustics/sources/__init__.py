"""What sends the sound out: surfaces that radiate, and fields given on a plane."""
