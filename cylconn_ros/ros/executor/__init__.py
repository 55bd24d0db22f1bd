"""Executor for samples: serialized messages from rcl to the connector and back."""
