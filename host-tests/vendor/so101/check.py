"""Runs programs for Feetech servos on virtual arms, and compares the results with pages.

Usage: check.py DOCS PYTHON FTSERVO_PYTHON [--write]

DOCS is the folder of the pages, PYTHON and FTSERVO_PYTHON the Python of each environment. `--write` writes the pages.
"""

import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pages
import table
from runs import Pythons

# Number of runs at the same time. They mostly wait.
WORKERS = 4


def main(docs: Path, pythons: Pythons, write: bool) -> None:
    """Check all pages."""
    upstream = sorted((docs / "upstream").glob("*.md"))
    if not upstream:
        sys.exit(f"{docs}/upstream has no page")
    # The table's runs take the workers first; a page waits for its own.
    with ThreadPoolExecutor(WORKERS) as workers, ThreadPoolExecutor() as waiting:
        checks = {docs / "so101.md": waiting.submit(table.checked, docs / "so101.md", pythons, workers, write)}
        checks |= {page: waiting.submit(pages.checked, page, pythons, workers, write) for page in upstream}
    differing = []
    for page, check in checks.items():
        text = check.result()
        if write:
            page.write_text(text)
        elif text != page.read_text():
            differing.append(page.name)
    if differing:
        sys.exit(
            f"FAILED: other results than on {', '.join(differing)}: see above, or `cargo xtask vendor so101 --write`"
        )
    print(f"{len(checks)} pages have these results")


if __name__ == "__main__":
    if len(sys.argv) not in (4, 5) or sys.argv[4:] not in ([], ["--write"]):
        sys.exit(__doc__)
    main(Path(sys.argv[1]), Pythons(*sys.argv[2:4]), len(sys.argv) == 5)
