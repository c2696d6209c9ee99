"""A zip file with everything that a reviewer needs to check claims, with names or blind."""
