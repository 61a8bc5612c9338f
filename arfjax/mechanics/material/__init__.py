"""What tissue is at the points of a mesh: relaxations, complex moduli, lesions."""
