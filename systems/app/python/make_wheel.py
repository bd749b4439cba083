"""Makes the wheel of the module: make_wheel.py LIBRARY SCENES OUT VERSION. Standard library only; the same input gives the same bytes.

The wheel holds libtrocar and the shared libraries that it needs beyond the C and C++ runtimes, found by ldd: libtrocar looks for
them beside itself ($ORIGIN), and so do they.
"""

import base64
import hashlib
import re
import subprocess
import sys
import zipfile
from pathlib import Path

RUNTIME = re.compile(r"lib(c|m|dl|rt|pthread|resolv|util|stdc\+\+|gcc_s)\.so|ld-linux|linux-vdso")
STAMP = (2020, 1, 1, 0, 0, 0)


def needed(library: Path) -> list[Path]:
    """Shared libraries that a library needs, its own among them."""
    said = subprocess.run(["ldd", library], check=True, capture_output=True, text=True).stdout
    found = [Path(line.split("=>")[1].split("(")[0].strip()) for line in said.splitlines() if "=>" in line]
    missing = [line.strip() for line in said.splitlines() if "not found" in line]
    if missing:
        sys.exit(f"{library}: {missing}")
    return [library] + sorted(path for path in found if not RUNTIME.match(path.name))


def main() -> None:
    library, scenes, out, version = Path(sys.argv[1]), Path(sys.argv[2]), Path(sys.argv[3]), sys.argv[4]
    own = Path(__file__).parent / "trocar"
    files: dict[str, bytes] = {f"trocar/{path.name}": path.read_bytes() for path in sorted(own.iterdir()) if path.suffix in (".py", ".typed")}
    for path in needed(library):
        name = "libtrocar.so.0" if path == library else path.name
        files[f"trocar/{name}"] = path.resolve().read_bytes()
    for path in sorted(scenes.rglob("*")):
        if path.is_file():
            files[f"trocar/scenes/{path.relative_to(scenes)}"] = path.read_bytes()
    info = f"trocar-{version}.dist-info"
    files[f"{info}/METADATA"] = (
        f"Metadata-Version: 2.1\nName: trocar\nVersion: {version}\nSummary: Virtual surgery: contact, deforming tissue and haptic forces\n"
        "License: Apache-2.0\nRequires-Python: >=3.9\nProvides-Extra: numpy\nRequires-Dist: numpy; extra == 'numpy'\n").encode()
    files[f"{info}/WHEEL"] = b"Wheel-Version: 1.0\nGenerator: trocar\nRoot-Is-Purelib: false\nTag: py3-none-linux_x86_64\n"
    record = "".join(
        f"{name},sha256={base64.urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b'=').decode()},{len(data)}\n"
        for name, data in files.items())
    files[f"{info}/RECORD"] = (record + f"{info}/RECORD,,\n").encode()
    wheel = out / f"trocar-{version}-py3-none-linux_x86_64.whl"
    with zipfile.ZipFile(wheel, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            entry = zipfile.ZipInfo(name, STAMP)
            entry.external_attr = (0o755 if ".so" in name else 0o644) << 16
            entry.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(entry, data)
    print(wheel)


if __name__ == "__main__":
    main()
