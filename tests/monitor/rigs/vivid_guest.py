"""A guest with the kernel's virtual camera (vivid): qemu, Debian's kernel, and this machine's own files, read only.

Loading a kernel module needs a kernel of one's own. The guest's is Debian's, unpacked from its package; its root is
this machine's over 9p, so that it runs the very environment of these tests. Nothing is installed, and nothing written
outside a folder. It runs without hardware acceleration (TCG): what a machine says of its /dev/kvm may not be true.
"""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

MODULES = ("virtio_pci", "9pnet_virtio", "9p", "vivid")
VIVID = "n_devs=1 node_types=0x1"

INIT = """#!/bin/busybox sh
/bin/busybox mkdir -p /proc /host
/bin/busybox mount -t proc none /proc
cd /modules
for module in {order}; do
  case $module in
    vivid.ko) /bin/busybox insmod $module {vivid} ;;
    *) /bin/busybox insmod $module ;;
  esac || echo "cannot load $module"
done
/bin/busybox mount -t 9p -o trans=virtio,version=9p2000.L,ro,msize=262144,cache=loose host /host || echo "no root"
/bin/busybox mount -t devtmpfs none /host/dev
/bin/busybox mount -t proc none /host/proc
/bin/busybox mount -t sysfs none /host/sys
/bin/busybox mount -t tmpfs none /host/run  # not on /tmp: the repository may lie there
/bin/busybox chroot /host /bin/sh -c '{command}' 2>&1
echo "guest ended with $?"
/bin/busybox poweroff -f
"""


def run_with_vivid(command: str, folder: Path, timeout_s: float = 900.0) -> str:
    """Run a shell command in the guest; give all that it said. Skips where there is no qemu, or no package."""
    qemu = shutil.which("qemu-system-x86_64")
    if qemu is None:
        pytest.skip("qemu is not installed (Debian: qemu-system-x86)")
    kernel, busybox = _unpacked("linux-image-amd64", folder), _unpacked("busybox-static", folder) / "bin" / "busybox"
    image = next((kernel / "boot").glob("vmlinuz-*"))
    order = list(_with_needs({path.stem.replace("-", "_"): path for path in kernel.rglob("*.ko")}))
    init = INIT.format(order=" ".join(path.name for path in order), vivid=VIVID, command=command.replace("'", "'\\''"))
    files = {"init": init.encode(), "bin/busybox": busybox.read_bytes()}
    files |= {f"modules/{path.name}": path.read_bytes() for path in order}
    (folder / "initrd").write_bytes(_cpio(files))
    share = "local,path=/,mount_tag=host,security_model=none,readonly=on,multidevs=remap"
    machine = ["-machine", "q35,accel=tcg", "-cpu", "max", "-m", "1500", "-smp", "2", "-nic", "none"]
    machine += ["-display", "none", "-no-reboot"]
    started = ["-kernel", str(image), "-initrd", str(folder / "initrd"), "-append", "console=ttyS0 quiet panic=-1"]
    log = folder / "guest.log"  # a file: what it said is there to read where it does not end in time
    with log.open("wb") as said:
        subprocess.run(
            [qemu, *machine, *started, "-virtfs", share, "-serial", "stdio", "-monitor", "none"],
            stdin=subprocess.DEVNULL,
            stdout=said,
            stderr=subprocess.STDOUT,
            timeout=timeout_s,
            check=False,
        )
    return log.read_text(errors="replace")


def _unpacked(package: str, folder: Path) -> Path:
    """Fetch a package from the system's own archive and unpack it, without installing it."""
    place = folder / package
    place.mkdir()
    if shutil.which("apt-get") is None or shutil.which("dpkg") is None:
        pytest.skip("the guest's kernel comes from Debian's archive: there is no apt-get here")
    name = package
    if package == "linux-image-amd64":  # it holds nothing itself: it names the newest
        told = subprocess.run(["apt-cache", "depends", package], capture_output=True, text=True, check=False).stdout
        name = next((line.split()[-1] for line in told.splitlines() if "linux-image-" in line and ":" in line), name)
    got = subprocess.run(["apt-get", "download", "-q", name], cwd=place, capture_output=True, check=False)
    file = next(place.glob("*.deb"), None)
    if got.returncode or file is None:
        pytest.skip(f"Debian's package {name} cannot be had")
    subprocess.run(["dpkg", "-x", file.name, "."], cwd=place, check=True, capture_output=True)
    return place


def _with_needs(known: dict[str, Path]) -> Iterator[Path]:
    """The modules and what they need, each after its needs; a module built into the kernel is not among the files."""
    given: set[str] = set()

    def each(name: str) -> Iterator[Path]:
        if name in given or name not in known:
            return
        given.add(name)
        data = known[name].read_bytes()
        start = data.find(b"\0depends=") + len(b"\0depends=")
        for need in data[start : data.index(b"\0", start)].decode().split(","):
            yield from each(need.replace("-", "_"))
        yield known[name]

    for module in MODULES:
        yield from each(module)


def _cpio(files: dict[str, bytes]) -> bytes:
    """An archive as the kernel takes for its first root ("newc")."""
    folders = sorted({parent.as_posix() for name in files for parent in Path(name).parents} - {"."})
    entries = [(name, 0o040755, b"") for name in folders]
    entries += [(name, 0o100755, data) for name, data in files.items()]
    entries.append(("TRAILER!!!", 0, b""))
    archive = b""
    for number, (name, mode, data) in enumerate(entries, start=1):
        fields = (number, mode, 0, 0, 1, 0, len(data), 0, 0, 0, 0, len(name) + 1, 0)
        head = b"070701" + "".join(f"{field:08x}" for field in fields).encode() + name.encode() + b"\0"
        archive += head + b"\0" * (-len(head) % 4) + data + b"\0" * (-len(data) % 4)
    return archive
