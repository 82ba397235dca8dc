"""Random changes of files."""

from __future__ import annotations

import random
import re
import struct

_NUMBERS = (0, 1, 2, -1, 127, 128, 255, 256, 32767, 65535, 65536, 2**24, 2**31 - 1, -(2**31))
_WORDS = (
    *(
        "null",
        "true",
        "''",
        "[]",
        "{}",
        "[[1]]",
        "{a: 1}",
        "0",
        "-1",
        "1.5",
        "1e400",
        "-1e-9",
        ".nan",
        "-.inf",
        "9" * 40,
    ),
    *(
        "0x10",
        "0o7",
        "2020-01-01",
        "1:30:00",
        "~",
        "*a",
        "&a b",
        "!!python/object/apply:os.getpid []",
        "<<",
        "? a",
        "---",
    ),
    *(
        "../../x.png",
        "~nobody/x.png",
        "/dev/null",
        "/dev/zero",
        ".",
        "required",
        "each",
        "skimage:brick",
        "skimage:none",
    ),
    *(
        "exemplar",
        "texture",
        "start.match",
        "edges.strength",
        "analysis.edges",
        "synthesis.optimise",
        "*.png",
        "a*[!x]?",
    ),
    *(
        "'\u202e'",
        "'\\x1b[31m'",
        '"\\x1b[31m"',
        '"\\ud800"',
        '"a\\nb"',
        "'é'",
        "'\U0001f600'",
        "x" * 300,
        "1024x1536",
        "auto",
    ),
)


def mutated(rng: random.Random, content: bytes) -> bytes:
    """Some bytes changed, removed, repeated or inserted."""
    data = bytearray(content)
    for _ in range(rng.choice((1, 1, 2, 4))):
        at = rng.randrange(len(data) + 1) if rng.random() < 0.5 else rng.randrange(min(len(data), 200) + 1)
        length = rng.choice((1, 2, 4, 16, 100))
        match rng.randrange(7):
            case 0:
                if at < len(data):
                    data[at] ^= 1 << rng.randrange(8)
            case 1:
                data[at : at + length] = rng.randbytes(length)
            case 2:
                data[at : at + 4] = struct.pack(rng.choice("<>") + "i", rng.choice(_NUMBERS))
            case 3:
                del data[at:]
            case 4:
                del data[at : at + length]
            case 5:
                data[at:at] = data[at : at + length] * rng.choice((1, 1, 50))
            case 6:
                data[at:at] = rng.randbytes(length)
    return bytes(data)


def mutated_text(rng: random.Random, text: str) -> str:
    """Some words or lines changed, removed, repeated or moved."""
    for _ in range(rng.choice((1, 1, 2, 3))):
        lines = text.split("\n")
        at = rng.randrange(len(lines))
        match rng.randrange(7):
            case 0 | 1 | 2:
                words = list(re.finditer(r"[\w.:/*-]+", text))
                if words:
                    one = rng.choice(words)
                    other = rng.choice(_WORDS) if rng.random() < 0.7 else rng.choice(words)[0]
                    text = text[: one.start()] + other + text[one.end() :]
            case 3:
                text = "\n".join(lines[:at] + lines[at + 1 :])
            case 4:
                text = "\n".join(lines[: at + 1] + lines[at:])
            case 5:
                text = "\n".join([*lines[:at], " " * rng.randrange(6) + lines[at].lstrip(), *lines[at + 1 :]])
            case 6:
                place = rng.randrange(len(text) + 1)
                text = (
                    text[:place]
                    + rng.choice(("[", "]", "{", "}", ":", ",", "#", "\t", "\0", '"', "\x85", "-"))
                    + text[place:]
                )
    return text


def odd_value(rng: random.Random) -> str:
    """A value as somebody may type it."""
    return rng.choice(_WORDS)
