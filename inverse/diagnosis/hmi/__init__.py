"""The diagnosis of harmonic motion imaging: what of the chain from sound to displacement a curve shows to be wrong."""
