"""Builds the wheel, as PEP 517 has it. The package is pure Python: its files, and three that describe them (PEP 427)."""

import base64
import hashlib
import pathlib
import re
import zipfile

_HERE = pathlib.Path(__file__).parent


def _project(key):
    """A value of pyproject.toml: one line, `key = "value"` or `key = ["value"]`. tomllib is younger than Python 3.9."""
    text = (_HERE / "pyproject.toml").read_text()
    return re.search(rf'^{key} = (?:\[|{{ text = )?"(.*?)"', text, re.MULTILINE).group(1)


def get_requires_for_build_wheel(config_settings=None):
    return []


def build_wheel(wheel_directory, config_settings=None, metadata_directory=None):
    stem = f"{_project('name').replace('-', '_')}-{_project('version')}"
    files = {f"lookout/{path.name}": path.read_bytes() for path in sorted((_HERE / "lookout").glob("*.py"))}
    files[f"{stem}.dist-info/METADATA"] = (
        f"Metadata-Version: 2.1\nName: {_project('name')}\nVersion: {_project('version')}\n"
        f"Summary: {_project('description')}\nRequires-Python: {_project('requires-python')}\n"
        f"License: {_project('license')}\nRequires-Dist: {_project('dependencies')}\n"
        f"Description-Content-Type: text/markdown\n\n{(_HERE / 'README.md').read_text()}"
    ).encode()
    files[f"{stem}.dist-info/WHEEL"] = b"Wheel-Version: 1.0\nGenerator: lookout\nRoot-Is-Purelib: true\nTag: py3-none-any\n"
    record = ""
    for name, content in files.items():
        digest = base64.urlsafe_b64encode(hashlib.sha256(content).digest()).rstrip(b"=").decode()
        record += f"{name},sha256={digest},{len(content)}\n"
    files[f"{stem}.dist-info/RECORD"] = f"{record}{stem}.dist-info/RECORD,,\n".encode()
    with zipfile.ZipFile(pathlib.Path(wheel_directory) / f"{stem}-py3-none-any.whl", "w", zipfile.ZIP_DEFLATED) as wheel:
        for name, content in files.items():
            # A fixed time: the same source gives the same wheel.
            wheel.writestr(zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0)), content)
    return f"{stem}-py3-none-any.whl"
