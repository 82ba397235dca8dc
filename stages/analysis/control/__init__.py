"""What a result is to follow: guides [Hertzmann2001]_, orientation fields [Wei2008]_, [Zhou2023]_, directions."""
