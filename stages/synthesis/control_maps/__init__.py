"""Control maps of an exemplar and of a target, made comparable."""
