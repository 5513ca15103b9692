"""Photographs that relit views are compared with."""

import pytest

from fipt.errors import FiptError
from fipt.scene.references import reference_files


def test_without_held_out_views_there_is_nothing_to_compare(tmp_path):
    with pytest.raises(FiptError, match="no held-out view can be compared"):
        reference_files(tmp_path, [])
