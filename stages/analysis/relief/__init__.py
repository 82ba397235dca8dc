"""Maps of a surface estimated from its colour or from photographs under several lights."""
