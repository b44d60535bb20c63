"""The subcommands of the command line, one module each; those of reports are modules there."""
