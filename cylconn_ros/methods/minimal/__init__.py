"""Method `minimal`: the scene in joint coordinates, integrated adaptively with events."""
