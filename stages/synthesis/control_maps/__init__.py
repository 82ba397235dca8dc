"""Control maps of an exemplar and of a target, made comparable, as [Wei2008]_ synthesises along them.

`control_features` is the stage; what lies beside it serves every method that follows control.
"""
