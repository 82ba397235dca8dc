"""Semi-procedural textures [Guehl2020]_: a structure that is computed, with details of an exemplar in its cells."""
