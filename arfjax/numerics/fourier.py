"""Lengths at which the fast Fourier transform is fast."""

from typing import cast

from scipy.fft import next_fast_len


def fast_length(n: int) -> int:
    """Smallest length from n on at which a transform of real values is fast."""
    return cast(int, next_fast_len(n, real=True))
