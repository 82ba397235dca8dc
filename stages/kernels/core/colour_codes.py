"""Numbers of the level that each value reaches, by a table instead of the curve that the levels lie on."""

from texloom.stages.kernels.core.compiled import compiled

SHIFT = 17
"""bits of a number in 32 bits that are not looked up: 64 places of the table for each power of 2"""


@compiled
def find_codes(bits, levels, table, codes):
    """Fill ``codes`` with how many of ``levels`` each number is not below.

    Parameters
    ----------
    bits : (n,) int32, of numbers in float32, whose order they have; those below 0 count as 0
    levels : (m,) int32, rising, bits of positive numbers
    table : (k,) uint8, codes of the least numbers whose bits without the last `SHIFT` are 0, 1 ... k - 1; larger
        ones have the last code
    codes : (n,) uint8
    """
    last = levels.size
    for index in range(bits.size):
        own = bits[index]
        place = own >> SHIFT
        if place < 0:
            codes[index] = 0
        elif place >= table.size:
            codes[index] = last
        else:
            code = table[place]
            while code < last and levels[code] <= own:
                code += 1
            codes[index] = code
