"""Sizes in bytes."""

from __future__ import annotations

import pytest

from texloom.pipelines.byte_size import format_byte_size, parse_byte_size


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("70", 70),
        ("70B", 70),
        ("2kB", 2000),
        ("2KiB", 2048),
        ("512 MB", 512 * 10**6),
        ("512mib", 512 * 2**20),
        ("1.5g", 15 * 10**8),
        ("4GB", 4 * 10**9),
        ("4GiB", 4 * 2**30),
        (" 1Ti ", 2**40),
        ("0", 0),
    ],
)
def test_units_are_decimal_and_those_with_an_i_binary(text: str, expected: int) -> None:
    assert parse_byte_size(text) == expected


@pytest.mark.parametrize("text", ["", "much", "-1", "4PB", "1e9", "4GB4", "4GB more", "5iB", "1" * 16])
def test_what_is_no_size_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"^must be a size such as 20GB, 500MB or 4GiB, got '"):
        parse_byte_size(text)


@pytest.mark.parametrize(
    ("count", "expected"), [(0, "0 bytes"), (70, "70 bytes"), (1500, "1.5 kB"), (2**30, "1.1 GB"), (2e12, "2.0 TB")]
)
def test_sizes_are_written_in_decimal_units(count: float, expected: str) -> None:
    assert format_byte_size(count) == expected
