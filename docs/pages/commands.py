"""Every command with its options, as `--help` says, and what its exit code means."""

import re

from mission.base.errors import EXIT_CODES
from mission.cli import app

HEAD = """# Commands

Generated from the code (`python docs/generate.py`); `aerofed COMMAND --help` says the same.

## Exit codes

| code | what |
|---|---|
"""


def page() -> str:
    codes = "".join(f"| {code} | {what} |\n" for code, what in EXIT_CODES.items())
    text = app.generate_docs(output_format="markdown", recursive=True)
    text = text[text.index("## aerofed init") :]
    # Headings as on the other pages, examples as code.
    text = re.sub(r"^#+ (aerofed .+)$", r"## \1", text, flags=re.MULTILINE)
    text = re.sub(r"^```console\n(.+)\n```$", r"    \1", text, flags=re.MULTILINE)
    text = re.sub(r"^Example: (.+)$", r"    \1", text, flags=re.MULTILINE)
    text = re.sub(r"\n\*\*(Parameters|Arguments|Commands)\*\*:\n", "", text)
    return f"{HEAD}{codes}\n{text.strip()}\n"
