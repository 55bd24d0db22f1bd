"""The connector node: lifecycle, parameters, topics, diagnostics, recording."""
