"""Single pixels of synthesis; `test_correction` compares what they are chosen by with a slow twin."""

from texloom.stages.kernels.per_pixel.pixel import columns_to, piece_at, rows_to


def test_neighbours_are_in_scan_order() -> None:
    expected = [(r, c) for r in (-1, 0, 1) for c in (-1, 0, 1) if (r, c) != (0, 0)]
    assert [(rows_to(u), columns_to(u)) for u in range(8)] == expected


def test_pieces_are_numbered_squares_of_the_endless_result() -> None:
    pieces: dict[int, set[tuple[int, int]]] = {}
    for row in range(-6, 6):
        for column in range(-3, 9):
            number, down, across = piece_at(row, column, 3)
            assert (row - down) % 3 == (column - across) % 3 == 0
            pieces.setdefault(int(number), set()).add((down, across))
    assert len(pieces) == 16
    assert all(pixels == {(i, j) for i in range(3) for j in range(3)} for pixels in pieces.values())
