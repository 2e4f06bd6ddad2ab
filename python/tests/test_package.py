"""The package as a whole."""

import importlib.metadata
import pydoc

import armwire


def test_version_is_that_of_the_package() -> None:
    assert armwire.__version__ == importlib.metadata.version("armwire")


def test_asyncio_needs_no_import_of_its_own() -> None:
    assert armwire.aio.Ling.__module__ == "armwire.aio"


def test_help_has_short_types() -> None:
    text = pydoc.plain(pydoc.render_doc(armwire.Ling))
    # Python before 3.14 shows a type as text, with quotes.
    assert "move_deg(self, joints: ArrayLike, *, speed_deg_s: ArrayLike," in text.replace("'", "")
    assert "_typing" not in text


def test_first_screen_of_help_names_every_method() -> None:
    screen = pydoc.plain(pydoc.render_doc(armwire.Ling)).splitlines()[:24]
    methods = [name for name in dir(armwire.Ling) if not name.startswith("_")]
    assert [name for name in methods if f"`{name}`" not in "\n".join(screen)] == []
