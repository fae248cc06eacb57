"""The tools of `knotfab mcp`: the jobs of the command line for programs that call tools."""
