"""How stages are run: flows, the artifact store, runners, the command line. Knows nothing of texture."""
