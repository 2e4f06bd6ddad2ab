"""The reproductions on pages for other projects: a block of Python, and one with its output."""

import re
import tempfile
from concurrent.futures import Executor
from pathlib import Path

from runs import Pythons, run, settled

# Text without the mark of a block.
TEXT = "(?:(?!```).)*"
BLOCKS = re.compile(rf"```python\n(?P<code>{TEXT})```\n{TEXT}```text\n(?P<output>{TEXT})```\n", re.DOTALL)
# Maximum number of lines of a reproduction.
MAX_LINES = 19


def checked(page: Path, pythons: Pythons, workers: Executor, is_new: bool) -> str:
    """The page with the output of each block of Python that has one. A new one does not depend on the page."""
    text = page.read_text()
    blocks = list(BLOCKS.finditer(text))
    if not blocks:
        raise ValueError(f"{page.name} has no block of Python with its output")
    outputs = [workers.submit(output, page.name, block, pythons, is_new) for block in blocks]
    for block, shown in reversed(list(zip(blocks, outputs, strict=True))):
        start, end = block.span("output")
        text = text[:start] + shown.result() + text[end:]
    return text


def output(name: str, block: re.Match[str], pythons: Pythons, is_new: bool) -> str:
    """What the code of a block prints."""
    code = block["code"]
    if (lines := code.count("\n")) > MAX_LINES:
        raise ValueError(f"{name}: a block has {lines} lines of Python, the maximum is {MAX_LINES}")
    with tempfile.TemporaryDirectory() as folder:
        script = Path(folder) / "reproduction.py"
        script.write_text(code)
        expected = None if is_new else block["output"].strip()
        return settled(name, lambda: run(pythons.of(name), script), expected) + "\n"
