"""The executor that waits for message events and takes serialized messages."""
