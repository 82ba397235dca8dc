"""Similar neighbourhoods of an exemplar.

k-coherence [Tong2002]_, tree-structured vector quantisation [Wei2000]_, and appearance vectors
[LefebvreHoppe2006]_ with their similarity sets [LefebvreHoppe2005]_.
"""
