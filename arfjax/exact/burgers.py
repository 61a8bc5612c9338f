r"""Plane waves of finite amplitude that leave their source as a sine: harmonics in closed form.

All solve, or for the inviscid ones are limits of, Burgers' equation for P = p / p0,

$$ P_\sigma = P P_\theta + P_{\theta\theta} / \Gamma, \qquad P(0, \theta) = \sin\theta, \qquad
   P = \sum_n B_n \sin n\theta, $$

with theta = omega (t - z / c), sigma = beta omega p0 z / (rho c^3), the distance in lengths of shock formation, and the
Goldberg number Gamma = beta omega p0 / (rho c^3 alpha), alpha the attenuation of the fundamental, that of harmonic n
being n^2 alpha. The shock stands at theta = 0. Every function returns B_n for the given n >= 1.
"""

import numpy as np
from jaxtyping import Float, Int
from scipy import optimize, special

_NEGLIGIBLE = 40.0
"""Where Gaussian tails are cut: exp(-40) is 4e-18."""

Harmonics = Int[np.ndarray, " harmonic"]
Amplitudes = Float[np.ndarray, " harmonic"]


def fubini(n: Harmonics, sigma: float) -> Amplitudes:
    r"""Without loss, before a shock forms (sigma <= 1): $B_n = 2 J_n(n \sigma) / (n \sigma)$.

    Source: Fubini, Alta Frequenza 4 (1935) 530.
    """
    argument = n * sigma
    return 2.0 * special.jv(n, argument) / argument if sigma > 0.0 else (n == 1).astype(float)


def blackstock(n: Harmonics, sigma: float) -> Amplitudes:
    r"""Without loss but at the shock: Fubini's up to sigma = 1, the sawtooth's 2 / (n (1 + sigma)) far beyond.

    $$ B_n = \frac{2}{n \pi} [\sin\Phi_s + \frac{1}{\sigma} \int_{\Phi_s}^\pi \cos n (\Phi - \sigma \sin\Phi) d\Phi],
       \qquad \Phi_s = \sigma \sin\Phi_s, $$

    sin(Phi_s) being the shock's peak, 0 up to sigma = 1.

    Accuracy: rounding.
    Source: Blackstock, J. Acoust. Soc. Am. 39 (1966) 1019.
    """
    if sigma == 0.0:
        return fubini(n, sigma)
    shock = 0.0
    if sigma > 1.0:
        shock = optimize.root_scalar(lambda x: np.sinc(x / np.pi) - 1.0 / sigma, bracket=(0.0, np.pi), xtol=1e-15).root
    phase, weight = map(np.ravel, _gauss_legendre(shock, np.pi, 4 + int(0.5 * n.max() * (1.0 + sigma))))
    integral = np.cos(n[:, None] * (phase - sigma * np.sin(phase))[None, :]) @ weight
    return 2.0 / (n * np.pi) * (np.sin(shock) + integral / sigma)


def fay(n: Harmonics, sigma: float, goldberg_number: float) -> Amplitudes:
    r"""Shock in balance with viscosity: $B_n = (2 / \Gamma) / \sinh(n (1 + \sigma) / \Gamma)$.

    An exact solution of Burgers' equation, though not from a sine: the fundamental of `mendousse` at Gamma = 50 is
    below it by 0.6 % at sigma = 5 and by 0.2 % at 10.

    Source: Fay, J. Acoust. Soc. Am. 3 (1931) 222.
    """
    x = n * (1.0 + sigma) / goldberg_number
    return -4.0 / goldberg_number * np.exp(-x) / np.expm1(-2.0 * x)


def mendousse(n: Harmonics, sigma: float, goldberg_number: float) -> Amplitudes:
    r"""The exact solution from a sine, at any sigma > 0 and Gamma.

    By the Cole-Hopf transformation P is a mean of the initial sine,

    $$ P(\sigma, \theta) = \langle \sin(\theta + y) \rangle, \qquad
       \mathrm{weight}\ \exp[-(\Gamma / 2) (\cos(\theta + y) + y^2 / 2 \sigma)], $$

    in which, other than in the classical series of modified Bessel functions, nothing cancels for large Gamma.

    Accuracy: 1e-12 absolute, up to n = 256 and Gamma = 1e3. The trapezoidal rule in y and Gauss-Legendre
    panels in asinh(Gamma theta), which resolve the shock, both converge exponentially.
    Source: Mendousse, J. Acoust. Soc. Am. 25 (1953) 51; Cole, Q. Appl. Math. 9 (1951) 225; Hopf, Commun. Pure Appl.
    Math. 3 (1950) 201.
    """
    length = np.arcsinh(np.pi * goldberg_number)
    stretched, weight = _gauss_legendre(0.0, length, 12 + int(0.5 * n.max() * length))
    theta = np.sinh(stretched) / goldberg_number
    pressure = np.concatenate([_cole_hopf(panel, sigma, goldberg_number) for panel in theta])
    density = np.ravel(weight * np.cosh(stretched)) / goldberg_number * pressure
    return 2.0 / np.pi * np.sin(n[:, None] * np.ravel(theta)[None, :]) @ density


def _cole_hopf(theta: Float[np.ndarray, " theta"], sigma: float, goldberg_number: float) -> Float[np.ndarray, " theta"]:
    """P at the phases `theta`."""
    reach = np.sqrt(4.0 * sigma * (1.0 + _NEGLIGIBLE / goldberg_number))
    narrowest = min(0.5, np.sqrt(2.0 * sigma / (goldberg_number * (1.0 + sigma))))
    y = np.linspace(-reach, reach, 2 * int(np.ceil(2.0 * reach / narrowest)) + 1)
    shifted = theta[:, None] + y[None, :]
    exponent = -0.5 * goldberg_number * (np.cos(shifted) + (y**2 / (2.0 * sigma))[None, :])
    weight = np.exp(exponent - exponent.max(axis=1, keepdims=True))
    return np.sum(weight * np.sin(shifted), axis=1) / np.sum(weight, axis=1)


def _gauss_legendre(start: float, stop: float, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and weights (panel, node) on an interval cut into `n` panels, one for each wavelength at most."""
    nodes, weights = np.polynomial.legendre.leggauss(20)
    edges, width = np.linspace(start, stop, n, endpoint=False), (stop - start) / n
    return edges[:, None] + 0.5 * width * (nodes + 1.0)[None, :], np.tile(0.5 * width * weights, (n, 1))
