"""Heat and thermal dose."""
