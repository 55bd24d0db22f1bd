"""The connector: scene parameters, matching of samples, and the one public step."""
