"""Models of other programs (MJCF, URDF, Abaqus decks) as scenes."""
