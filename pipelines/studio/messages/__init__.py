"""The messages between the page and the server, of which `texloom.pipelines.studio.typescript` makes types."""
