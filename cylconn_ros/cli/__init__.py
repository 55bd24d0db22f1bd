"""The command line ``cylconn``: one module per command."""
