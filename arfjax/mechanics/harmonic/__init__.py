"""Motion that is harmonic or periodic in time."""
