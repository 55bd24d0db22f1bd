"""Slide and spin after elimination of the constrained components: friction, springs, contacts."""
