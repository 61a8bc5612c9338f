"""Motion under radiation force by an explicit scheme on a stencil: the fast path."""
