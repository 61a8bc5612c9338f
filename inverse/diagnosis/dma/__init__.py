"""The diagnosis of a dynamic mechanical analysis: what of solid, instrument and procedure a sweep shows to be wrong."""
