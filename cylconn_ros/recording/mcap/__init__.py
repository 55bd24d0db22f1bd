"""MCAP files: chunk buffer with compiled append, writer, reader, message blocks."""
