"""Writes new firmware with SOEM, as docs/firmware.md says: SCRIPT INTERFACE DOCUMENT LENGTH

The document's Python is run as it stands there, but for the interface's name and the file.
"""

import re
import sys
import tempfile
import time

import patience  # noqa: F401 for what it sets

_, interface, document, length = sys.argv
[snippet] = re.findall(r"```python\n(.*?)```", open(document).read(), re.DOTALL)
with tempfile.NamedTemporaryFile(suffix=".mgu") as image:
    image.write(bytes(number % 251 for number in range(int(length))))
    image.flush()
    assert '"eth0"' in snippet and '"firmware.mgu"' in snippet
    snippet = snippet.replace('"eth0"', repr(interface))
    snippet = snippet.replace('open("firmware.mgu"', f"open({image.name!r}")
    exec(compile(snippet, document, "exec"), {})
# The gateway starts again half a second later.
time.sleep(1.5)
