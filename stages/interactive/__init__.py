"""What programs that answer to a hand call directly: synthesis that is kept up to date while its input changes."""
