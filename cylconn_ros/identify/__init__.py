"""What a measured motion tells about the friction of its joint."""
