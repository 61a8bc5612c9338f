"""Damage to files as it happens: cut off, bits flipped, lines lost, doubled or swapped, cells replaced."""

from collections.abc import Iterator

import numpy as np

_INTRUDERS = (
    b"",
    b"nan",
    b"inf",
    b"1e400",
    b"-1",
    b"0",
    b"\x00",
    b"\xff",
    b'"',
    b"[",
    b"\r",
    b"\xe2\x80\xa8",
    b"\x1b[2J",
)


def mutations(content: bytes, *, seed: int, count: int) -> Iterator[bytes]:
    """`count` damaged copies of a file's content."""
    random = np.random.default_rng(seed)
    kinds = (_truncated, _flipped, _lost_line, _doubled_line, _swapped_lines, _intruded)
    for number in range(count):
        yield kinds[number % len(kinds)](content, random)


def _truncated(content: bytes, random: np.random.Generator) -> bytes:
    return content[: random.integers(len(content))]


def _flipped(content: bytes, random: np.random.Generator) -> bytes:
    damaged = bytearray(content)
    for place in random.integers(len(content), size=random.integers(1, 5)):
        damaged[place] ^= 1 << int(random.integers(8))
    return bytes(damaged)


def _lost_line(content: bytes, random: np.random.Generator) -> bytes:
    lines = content.splitlines(keepends=True)
    del lines[random.integers(len(lines))]
    return b"".join(lines)


def _doubled_line(content: bytes, random: np.random.Generator) -> bytes:
    lines = content.splitlines(keepends=True)
    place = int(random.integers(len(lines)))
    return b"".join([*lines[: place + 1], *lines[place:]])


def _swapped_lines(content: bytes, random: np.random.Generator) -> bytes:
    lines = content.splitlines(keepends=True)
    first, second = random.integers(len(lines), size=2)
    lines[first], lines[second] = lines[second], lines[first]
    return b"".join(lines)


def _intruded(content: bytes, random: np.random.Generator) -> bytes:
    start = int(random.integers(len(content)))
    stop = start + int(random.integers(6))
    return content[:start] + _INTRUDERS[random.integers(len(_INTRUDERS))] + content[stop:]
