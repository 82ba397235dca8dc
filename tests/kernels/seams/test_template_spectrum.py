import numpy as np

from tests.kernels.seams import naive
from texloom.stages.kernels.seams.template_spectrum import template_spectrum


def test_products_are_summed_in_any_spans(rng: np.random.Generator) -> None:
    template, exemplar = rng.normal(size=(2, 4, 6, 10)).astype(np.float32)
    expected = naive.template_spectrum(template.view(np.complex64), exemplar.view(np.complex64))
    for span in ((0, 2), (2, 6)):
        template_spectrum(template, exemplar, *span)
    np.testing.assert_allclose(template[-1].view(np.complex64), expected, rtol=1e-5, atol=1e-5)
