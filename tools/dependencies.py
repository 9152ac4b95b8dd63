"""Prints the packages that pyproject.toml asks for, one a line, so that they install before the build that needs them.

`maturin develop` would install them too, but resolves them anew on every call; this runs once.
"""

import re
from pathlib import Path

text = (Path(__file__).parent.parent / "pyproject.toml").read_text()
# tomllib came with Python 3.11; the two lists wanted here are simple enough for 3.10.
for table in (r"^dependencies = \[(.*?)^\]", r"^dev = \[(.*?)\]"):
    block = re.search(table, text, re.M | re.S)
    assert block is not None, f"pyproject.toml has no {table}"
    for requirement in re.findall(r'^[^#\n]*?"([^"]+)"|, "([^"]+)"', block.group(1), re.M):
        print('"' + (requirement[0] or requirement[1]) + '"')
