"""No code that decides pixels calls what computes other last bits on another processor.

Such are BLAS and LAPACK, which add in another order, and functions of NumPy and OpenCV that have versions for
several sets of vector instructions, which fuse products with sums or use other polynomials. Measures and reports
may, as they decide no pixels, but for the scores that choose between two textures, which are rounded.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.conftest import ROOT

STAGES = ROOT / "stages"

BLAS = set(
    re.findall(
        r"\w+",
        "dot vdot inner matmul tensordot vecdot matvec vecmat cov corrcoef polyfit solve lstsq inv pinv det "
        "slogdet svd eig eigh eigvalsh qr cholesky multi_dot matrix_rank matrix_power norm splu spsolve spilu "
        "factorized cg gmres eigsh svds least_squares minimize curve_fit roots "
        "CubicSpline make_interp_spline RBFInterpolator reverse_cuthill_mckee",
    )
)
"""functions that call it, of NumPy, SciPy and others"""

DISPATCHED = set(
    re.findall(
        r"\w+",
        "exp exp2 expm1 log log2 log10 log1p sin cos tan arcsin arccos arctan arctan2 sinh cosh tanh arcsinh "
        "arccosh arctanh cbrt power float_power angle geomspace logspace hanning hamming blackman kaiser sinc "
        "logaddexp partition argpartition unwrap",
    )
)
"""functions of NumPy"""

OPENCV = set(
    re.findall(
        r"\w+",
        "GaussianBlur Sobel Scharr Laplacian remap warpAffine warpPerspective meanStdDev sqrBoxFilter "
        "sepFilter2D filter2D SIFT ORB cartToPolar polarToCart magnitude phase exp log pow gemm solve invert "
        "eigen SVDecomp PCACompute getRectSubPix getGaborKernel undistort findHomography "
        "getPerspectiveTransform perspectiveTransform transform reduce normalize norm bilateralFilter "
        "cornerHarris cornerSubPix goodFeaturesToTrack",
    )
)
"""functions of OpenCV"""

ALLOWED = {
    "numerics/matrices.py: linalg": "the class of its errors alone",
    "common/grids/screened_poisson.py: @": "of a sparse matrix: SciPy adds in the order of the entries",
    "common/surface/vertex_graph.py: @": "of a sparse matrix",
    "analysis/regularity/deformed_lattice.py: @": "of a sparse matrix",
    "analysis/photographs/flattening.py: @": "of a sparse matrix",
    "synthesis/inverse/epitome.py: @": "of a sparse matrix",
    "common/surface/surface_phases.py: splu": "on meshes alone; phases are rounded to 2^-32 cycles",
    "analysis/regularity/lattice.py: cv2.filter2D": "adds entries, all with weight 1",
    "common/regularity/lattice_cells.py: cv2.filter2D": "of 64 bits, which has one version",
    "synthesis/stitching/similar_places.py: cv2.filter2D": "multiples of 2^-12, whose sums are exact",
    "analysis/control/orientation_field.py: cv2.filter2D": "of 13 px: by Fourier transforms, of one version",
    "analysis/one_off/unlikeness.py: partition": "only the value at the place is read, which has one order",
    "interactive/photo_session.py: cv2.remap": "draws a preview",
}
"""what may be called where, and why"""


def calls(tree: ast.AST) -> Iterator[tuple[str, int]]:
    """The name of everything that is not independent of the processor, and its line."""
    owners = {id(node.func): node for node in ast.walk(tree) if isinstance(node, ast.Call)}
    for node in ast.walk(tree):
        line = getattr(node, "lineno", 0)
        if isinstance(node, ast.BinOp | ast.AugAssign) and isinstance(node.op, ast.MatMult):
            yield "@", line
        elif isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] in (
            "scipy",
            "sklearn",
            "numpy",
        ):
            yield from ((alias.name, line) for alias in node.names if alias.name in BLAS | DISPATCHED)
        elif isinstance(node, ast.Attribute):
            owner = ast.unparse(node.value)
            call = owners.get(id(node))
            named = {} if call is None else {keyword.arg: keyword.value for keyword in call.keywords}
            if owner == "cv2":
                if node.attr in OPENCV:
                    yield f"cv2.{node.attr}", line
            elif owner in ("np.linalg", "numpy.linalg", "scipy.linalg", "linalg", "scipy.sparse.linalg"):
                if not (node.attr == "norm" and "axis" in named):  # then it adds squares
                    yield "linalg" if node.attr == "LinAlgError" else node.attr, line
            elif owner in ("np", "numpy") and node.attr in BLAS | DISPATCHED:
                yield node.attr, line
            elif node.attr == "dot":
                yield "dot", line
            elif (node.attr == "argsort" and "kind" not in named) or (
                node.attr == "einsum" and "optimize" in named
            ):
                yield node.attr, line


def found(folder: Path) -> dict[str, int]:
    """What a folder calls that depends on the processor, by file and name, with the last line of each."""
    files = [path for path in sorted(folder.rglob("*.py")) if "evaluation" not in path.parts]
    return {
        f"{path.relative_to(folder)}: {name}": line
        for path in files
        for name, line in calls(ast.parse(path.read_text()))
    }


def test_what_decides_pixels_does_not_depend_on_the_processor() -> None:
    here = found(STAGES)
    assert {name: line for name, line in here.items() if name not in ALLOWED} == {}
    assert [name for name in ALLOWED if name not in here] == []


@pytest.mark.parametrize(
    ("source", "name"),
    [("a @ b", "@"), ("a @= b", "@"), ("np.dot(a, b)", "dot"), ("a.dot(b)", "dot"), ("np.linalg.inv(a)", "inv"),
     ("np.linalg.norm(a)", "norm"), ("np.einsum('ij,jk', a, b, optimize=True)", "einsum"), ("np.exp(a)", "exp"),
     ("from scipy.sparse.linalg import splu", "splu"), ("scipy.sparse.linalg.splu(a)", "splu"),
     ("cv2.GaussianBlur(a, (0, 0), 2)", "cv2.GaussianBlur"), ("np.argsort(a)", "argsort"),
     ("a.argsort()", "argsort"),
     ("map(np.exp, a)", "exp"), ("cv2.SIFT.create()", "cv2.SIFT")],
)  # fmt: skip
def test_the_check_finds(source: str, name: str) -> None:
    assert name in dict(calls(ast.parse(source)))


@pytest.mark.parametrize(
    "source",
    [
        "np.linalg.norm(a, axis=1)",
        "np.einsum('ij,jk', a, b)",
        "exp(a)",
        "a.argsort(kind='stable')",
        "@a\ndef b(): 0",
    ],
)
def test_the_check_leaves_out(source: str) -> None:
    assert list(calls(ast.parse(source))) == []
