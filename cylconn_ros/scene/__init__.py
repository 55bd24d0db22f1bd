"""The scene: parameters of a connector, their schema, checks and files."""
