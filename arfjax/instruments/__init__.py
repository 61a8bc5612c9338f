"""What an instrument would have read.

Of temperature thermocouples and magnetic-resonance thermometry, of motion speckle tracking and harmonic motion imaging,
of moduli dynamic mechanical analysis. Each is a frozen closure that is perfect as it stands.
"""
