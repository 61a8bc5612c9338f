"""What an instrument would have read: thermocouples and magnetic-resonance thermometry."""
