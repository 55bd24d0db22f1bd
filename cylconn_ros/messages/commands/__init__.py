"""Commands to a connector: what they say, and which are in force."""
