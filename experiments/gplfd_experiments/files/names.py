"""Names of files."""

import hashlib
import re


def file_name(text: str) -> str:
    """Return a name for a file or folder, another one for every text.

    Letters, digits, "_" and "-" stay as they are.
    """
    safe = re.sub(r"[^\w-]+", "_", text, flags=re.ASCII)[:60]
    if safe == text:
        return text
    # Other texts may become the same.
    return f"{safe}-{hashlib.sha256(text.encode()).hexdigest()[:8]}"
