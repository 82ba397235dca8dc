"""Writers of exports, one module a kind of file; none is imported before it writes."""
