"""The package as a whole."""

import ast
import importlib.metadata
import inspect
import pydoc
import subprocess
import sys

import pytest

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


def test_command_imports_neither_numpy_nor_asyncio() -> None:
    program = "import armwire._command, sys; print(*sorted({'asyncio', 'numpy'} & set(sys.modules)))"
    output = subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True)
    assert output.stdout == "\n"


def test_every_public_name_is_found_at_first_use() -> None:
    assert [name for name in armwire.__all__ if name not in dir(armwire) or not hasattr(armwire, name)] == []


def test_type_checkers_see_the_names_of_first_use() -> None:
    checked = next(node for node in ast.parse(inspect.getsource(armwire)).body if isinstance(node, ast.If))
    imports = [node for node in checked.body if isinstance(node, ast.ImportFrom)]
    names = {f".{node.module or ''}": tuple(name.name for name in node.names) for node in imports}
    # Modules, and names within modules.
    assert names.pop(".") == ("aio", "errors")
    assert names == vars(armwire)["_NAMES"]


def test_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="module 'armwire' has no attribute 'Lign'"):
        armwire.Lign  # type: ignore[attr-defined]  # noqa: B018
