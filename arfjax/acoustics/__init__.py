"""The one-way sound field of a focused bowl in layers, and what it deposits."""
