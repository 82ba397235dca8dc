"""What other programs need to use texloom; nothing here imports the rest of it."""
