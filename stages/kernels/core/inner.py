"""How kernels are compiled that only other kernels call."""

import functools

import numba

inner = functools.partial(numba.njit, cache=True, nogil=True, no_cpython_wrapper=True, no_cfunc_wrapper=True)
"""decorator of a kernel that Python does not call, with or without further options, which compiles in less time"""
