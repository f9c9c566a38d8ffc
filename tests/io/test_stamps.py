"""A stamp is found again, and the picture stays what it was to every reader."""

from __future__ import annotations

from io import BytesIO

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from pinholify.io.images import decode_image, encode_image
from pinholify.io.stamps import REACH, stamp_of, stamped

IDENTITY = "0123456789abcdef" * 2


@pytest.mark.parametrize("name", ["a.png", "a.jpg"])
@pytest.mark.parametrize("shape", [(5, 7), (5, 7, 3)])
def test_a_stamped_picture_is_the_same_picture(name, shape):
    plain = encode_image(np.random.default_rng(0).integers(0, 255, shape, dtype=np.uint8), name)
    marked = stamped(plain, IDENTITY)
    assert stamp_of(marked[:REACH]) == IDENTITY
    assert stamp_of(plain) is None
    np.testing.assert_array_equal(decode_image(marked, name), decode_image(plain, name))
    with Image.open(BytesIO(marked)) as picture:
        picture.load()
        text = picture.info["Software"] if name == "a.png" else picture.info["comment"].decode()
        assert text.startswith("pinholify ")
        assert text.endswith(IDENTITY)


def test_other_formats_are_refused():
    with pytest.raises(ValueError, match="only PNG and JPEG"):
        stamped(b"BM", IDENTITY)


@given(st.binary(max_size=REACH))
def test_no_stamp_in_anything(data):
    assert stamp_of(data) is None
