"""Names of files."""

import hashlib
import re


def file_name(text: str) -> str:
    """Return a name for a file or folder, different for every text.

    Letters, digits, "_" and "-" are unchanged.
    """
    safe = re.sub(r"[^\w-]+", "_", text, flags=re.ASCII)[:60]
    if safe == text:
        return text
    # Different texts may otherwise become equal.
    return f"{safe}-{hashlib.sha256(text.encode()).hexdigest()[:8]}"
