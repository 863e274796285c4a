"""The subcommands of ``gplfd``, one module each; heavy imports wait until one runs."""
