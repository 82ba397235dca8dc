"""Meshes: charts, control maps and the direction of a texture on a surface [LefebvreHoppe2006]_."""
