"""The files of a recording: formats, compression, order of messages, one way to open them."""
