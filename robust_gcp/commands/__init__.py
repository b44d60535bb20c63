"""The subcommands of the command line, one module each; those of studies are modules there."""
