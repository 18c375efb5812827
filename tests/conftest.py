"""Shapes and types are checked at run time in every test (jaxtyping + beartype)."""

import os
from pathlib import Path

import pytest
from jaxtyping import install_import_hook

install_import_hook("scene4d", "beartype.beartype")

SHARED = Path(os.environ.get("SCENE4D_DATA", Path(__file__).parents[2] / "shared" / "data"))


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Real recordings with known cameras; skipped with one sentence where they are absent."""
    if not SHARED.is_dir():
        pytest.skip(f"the real recordings are not at {SHARED}; set SCENE4D_DATA")
    return SHARED
