"""What generators say where there is nothing to hide."""


class NoSuchEffect(ValueError):
    """No strength of an effect shows as much as is asked for, or nothing is known of tissue that it reaches."""
