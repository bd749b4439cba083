#!/usr/bin/env bash
# Tries packages: packages.sh FOLDER [chroot]. Contents of the .debs; the wheel in a folder of its own runs a scene by name from an
# empty folder; with `chroot` (root, debootstrap, network) the .debs in a bare Debian 12, which takes minutes.
set -euo pipefail
folder=$(realpath "$1")
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
fail() { echo "packages: $*" >&2; exit 1; }
holds() {  # package file...
    local list
    list=$(dpkg-deb --contents "$folder/$1"_*.deb | awk '{print $6}')
    for file in "${@:2}"; do grep -qx "\./usr/$file" <<<"$list" || fail "$1 holds no /usr/$file"; done
}
holds libtrocar0 lib/libtrocar.so.0 share/trocar/scenes/palpate.toml
holds libtrocar-dev include/trocar/trocar.h include/trocar/systems/frame/frame.hpp lib/libtrocar.so lib/pkgconfig/trocar.pc lib/cmake/trocar/trocarConfig.cmake
holds trocar bin/trocar libexec/trocar/trocar-assimp-reader
holds python3-trocar lib/python3/dist-packages/trocar/__init__.py lib/python3/dist-packages/trocar/py.typed
for package in libtrocar0 trocar; do
    dpkg-deb --field "$folder/$package"_*.deb Depends | grep -q libembree || fail "$package does not depend on Embree"
done
program='
import trocar
with trocar.Sim("probe_on_liver", set={"liver.triangles": 500}) as sim:
    sim.step(20)
    print("trocar", trocar.__version__, "ran", sim.time, "s, state", sim.hash)'
mkdir "$work/site" "$work/empty"
python3 -m zipfile -e "$folder"/trocar-*.whl "$work/site"
(cd "$work/empty" && env -u TROCAR_SCENES -u TROCAR_LIBRARY PYTHONPATH="$work/site" python3 -c "$program") || fail "the wheel does not run"
# the .debs unpacked: program and module find scenes beside themselves
mkdir "$work/unpacked"
for package in "$folder"/*.deb; do dpkg-deb --extract "$package" "$work/unpacked"; done
unpacked="$work/unpacked/usr"
(cd "$work/empty" && env -u TROCAR_SCENES "$unpacked/bin/trocar" run probe_on_liver --seconds 0.2 --no-render --no-player --set liver.triangles=500) || fail "trocar does not run"
(cd "$work/empty" && env -u TROCAR_SCENES -u TROCAR_LIBRARY PYTHONPATH="$unpacked/lib/python3/dist-packages" LD_LIBRARY_PATH="$unpacked/lib" python3 -B -c "$program") || fail "the module does not run"
[ "${2:-}" = chroot ] || exit 0
root=$work/root
chroot_run() { chroot "$root" env -u TROCAR_SCENES -u TROCAR_LIBRARY -u PYTHONPATH LC_ALL=C.UTF-8 DEBIAN_FRONTEND=noninteractive sh -c "$1"; }
debootstrap --variant=minbase bookworm "$root" >"$work/log" 2>&1 || { tail -5 "$work/log"; fail "no bare Debian"; }
mkdir "$root/packages" "$root/empty" && cp "$folder"/*.deb "$folder"/*.whl "$root/packages"
settle() { chroot_run "apt-get update -qq && apt-get install -y -qq --no-install-recommends $1" >"$work/log" 2>&1 || { tail -20 "$work/log"; fail "$1 does not install"; }; }
settle python3
chroot_run "mkdir /site && python3 -m zipfile -e /packages/*.whl /site && cd /empty && PYTHONPATH=/site python3 -c '$program'" || fail "the wheel does not run in a bare Debian"
settle "/packages/*.deb"
mount -t proc proc "$root/proc"  # as every container has it: the program asks it where it is
trap 'umount "$root/proc"; rm -rf "$work"' EXIT
chroot_run "cd /empty && trocar run probe_on_liver --seconds 0.2 --no-render --no-player --set liver.triangles=500 --out /empty/run" || fail "trocar does not run"
chroot_run "cd /empty && python3 -c '$program'" || fail "the module does not run"
