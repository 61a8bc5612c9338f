"""What the package says to its user when input is wrong or is used outside the range that its source covers."""


class InputError(ValueError):
    """Input that cannot be used, said in one line: what, where, what was expected and what to do.

    Commands turn it into that line on the error stream and exit status 2; no file is left behind. Whatever a file or
    its name bring into the message, it stays one line without control characters.
    """

    def __init__(self, message: str) -> None:
        """Take the message, with line breaks as blanks and other control characters spelled out."""
        line = " ".join(part.strip() for part in message.splitlines())
        super().__init__("".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in line))


class ExtrapolationWarning(UserWarning):
    """A law was evaluated outside the range of the measurements behind it; the value is given all the same."""
