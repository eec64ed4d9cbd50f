"""The command ``ftp-dent``: one module a command."""
