"""The same work by other codes, each in a process of its own."""
