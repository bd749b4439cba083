#!/usr/bin/env bash
# Sets up a bare Debian 12 machine and runs Trocar's main jobs.
set -euo pipefail
cd "$(dirname "$0")"

usage() {
    cat <<'TXT'
usage: ./trocar.sh COMMAND

  demo   install what is missing, build the programs, run the three scenes into out/demo/ (pictures, film, figures)
  test   install what is missing, build, run every test but the long ones
  long   build, run the long tests (sweeps, 10,000-frame books)
  debug  build for debuggers with the library's assertions, run the unit tests
  asan   build with address and undefined-behaviour sanitizers, run the unit tests: ./trocar.sh asan [short] [arguments of ctest]
  tsan   build with the thread sanitizer, run the live tests and a live run
  fuzz   build with sanitizers, damage every kind of input for 10 minutes each: ./trocar.sh fuzz [MINUTES [ENDING...]];
         or run random scenes and judge their physics: ./trocar.sh fuzz physics [MINUTES [SEED]], findings in out/fuzz/
  bench  build the bench program and run one of its suites: ./trocar.sh bench content [arguments]
  package  build Debian packages (libtrocar0, libtrocar-dev, trocar, python3-trocar) and a Python wheel into out/packages/ and
         try them: contents, the wheel in a folder of its own; `package chroot`: also the .debs in a bare Debian made by debootstrap
  docs   build the documentation site into out/docs/site: pages, a picture of every scene, the interfaces of C and Python
  build  install what is missing, build
TXT
}

packages=(g++ cmake ninja-build libembree-dev libeigen3-dev libtbb-dev libosmesa6-dev libtomlplusplus-dev libcli11-dev
    nlohmann-json3-dev libpng-dev libjpeg-dev libgif-dev zlib1g-dev libdeflate-dev libzstd-dev libmeshoptimizer-dev libinsighttoolkit5-dev libpugixml-dev libassimp-dev libgtest-dev assimp-testmodels libwebsockets-dev)
optional=(ffmpeg libcoin-dev parallel libopenigtlink-dev)

options=()  # for cmake
started=$SECONDS
step() { printf '[%4d s] %s\n' $((SECONDS - started)) "$*"; }

install_packages() {
    local missing=() p
    for p in "$@"; do dpkg-query -W -f='${Status}' "$p" 2>/dev/null | grep -q 'ok installed' || missing+=("$p"); done
    [ ${#missing[@]} -eq 0 ] && return 0
    step "installing ${missing[*]}"
    local sudo=""
    [ "$(id -u)" -eq 0 ] || sudo=sudo
    export DEBIAN_FRONTEND=noninteractive
    $sudo apt-get update -qq >/dev/null
    $sudo apt-get install -y -qq --no-install-recommends "${missing[@]}" >/dev/null
}

setup() {
    install_packages "${packages[@]}"
    install_packages "${optional[@]}" || step "an optional package is not to be had (${optional[*]}): going on without"
    # for the 3D player of report.html, whose packages npm loads during the build
    command -v npm >/dev/null || install_packages nodejs npm || step "nodejs or npm is not to be had: reports will have no 3D player"
}

build() {  # preset target...; without targets everything
    setup
    step "configuring ($1)"
    cmake --preset "$1" "${options[@]}" >"build-$1.log" 2>&1 || { cat "build-$1.log"; exit 1; }
    rm -f "build-$1.log"
    step "building ($1)"
    cmake --build --preset "$1" -- --quiet "${@:2}"
    step "built"
}

run_tests() {  # preset label
    step "testing ($1)"
    ctest --test-dir "build/$1" -j "$(nproc)" --output-on-failure "${@:2}"
    step "done"
}

# The site's sources are put together in one folder: links of README.md lead from the root, those of docs/ from there.
make_docs() {
    local source=out/docs/source
    mkdir -p "$source" out/docs/doxygen
    step "drawing every scene"
    python3 docs/site/gallery.py build/release/trocar content/scenes out/docs/gallery
    cp docs/*.md docs/*.png docs/*.c docs/site/*.md out/docs/gallery/* "$source"
    sed 's,](docs/,](,g; s,^# Trocar$,# Overview,' README.md >"$source/readme.md"
    # the site has no sources: what leads to them stays as text
    sed -i -E 's,\[([^]]*)\]\((\.\./|systems/|components/|content/)[^)]*\),\1,g' "$source"/*.md
    step "reading the interfaces"
    doxygen - <<'TXT' >out/docs/doxygen.log
QUIET = YES
GENERATE_HTML = NO
GENERATE_LATEX = NO
GENERATE_XML = YES
OUTPUT_DIRECTORY = out/docs/doxygen
INPUT = systems/app/interface/trocar/trocar.h
OPTIMIZE_OUTPUT_FOR_C = YES
JAVADOC_AUTOBRIEF = YES
EXTRACT_ALL = YES
MACRO_EXPANSION = YES
INPUT_FILTER = "sed -E '1s,/[*] ,/** @file trocar.h @brief ,; /[*] ----/b; s,^( *)/[*] ,\1/** ,; t; s,([^ ].*)/[*] ,\1/**< ,'"
TXT
    step "writing the pages"
    TROCAR_SOURCE=$PWD TROCAR_DOXYGEN=$PWD/out/docs/doxygen/xml TROCAR_LIBRARY=$PWD/build/release/libtrocar.so.0 \
        python3 -m sphinx -q -W --keep-going -c docs/site "$source" out/docs/site
    step "done: open out/docs/site/index.html"
}

# The .debs and the wheel of what is built, into a folder.
pack() {
    mkdir -p "$1"
    cpack --config build/release/CPackConfig.cmake -B "$1/work" >"$1/cpack.log" || { cat "$1/cpack.log"; exit 1; }
    mv "$1"/work/*.deb "$1/" && rm -r "$1/work" "$1/cpack.log"
    python3 systems/app/python/make_wheel.py build/release/wheel/libtrocar.so.0 content/scenes "$1" "$(sed -n 's/^project(trocar VERSION \([0-9.]*\).*/\1/p' CMakeLists.txt)"
}

case "${1:-}" in
    build) build release ;;
    docs)
        build release programs trocar_c
        install_packages python3 doxygen python3-sphinx python3-myst-parser python3-breathe
        make_docs
        ;;
    test) build release; run_tests release -LE long ;;
    long) build release; run_tests release -L long ;;
    bench)
        install_packages libbenchmark-dev
        install_packages libbullet-dev libfcl-dev libcgal-dev || step "a peer of the benches is not to be had: going on without"
        options+=(-DTROCAR_BUILD_BENCH=ON)
        build release
        build/release/bench/trocar_bench "${@:2}"
        ;;
    debug) build debug; run_tests debug -L unit ;;
    asan)
        if [ "${2:-}" = short ]; then build asan-short short_tests; run_tests asan-short -L unit -LE slow "${@:3}"; exit; fi
        build asan; run_tests asan -L unit "${@:2}"
        ;;
    fuzz)
        if [ "${2:-}" = physics ]; then
            build release trocar_fuzz
            build/release/tests/trocar_fuzz --minutes "${3:-10}" --first "${4:-0}" --out out/fuzz
            exit
        fi
        setup
        cmake --preset asan >/dev/null
        cmake --build --preset asan -- --quiet trocar_mutate
        mkdir -p out/fuzz
        endings=("${@:3}")
        [ ${#endings[@]} -gt 0 ] || endings=(wrl x3d x3dv obj ply off vtk stl cap toml sweep csv udp json igtl recording)
        step "${2:-10} minutes each: ${endings[*]}"
        printf '%s\n' "${endings[@]}" | xargs -P "$(nproc)" -I{} bash -o pipefail -c "build/asan/tests/trocar_mutate --minutes ${2:-10} --only .{} --out out/fuzz | sed 's/^/{}: /'"
        ;;
    tsan)
        build tsan
        run_tests tsan -R 'Live[^r]' -j 1  # not the livers; one at a time: they run against the clock
        step "a live run"
        TSAN_OPTIONS="suppressions=$PWD/tests/races.supp:history_size=7" build/tsan/trocar run probe_on_liver --live --seconds 3 --out out/tsan
        ;;
    package)
        build release trocar trocar_c trocar_wheel trocar_engine trocar_systems trocar_content programs
        install_packages dpkg-dev python3 file
        # archives take their times from here: the same build packed again gives the same bytes
        export SOURCE_DATE_EPOCH=${SOURCE_DATE_EPOCH:-$(git log -1 --format=%ct 2>/dev/null || echo 1577836800)}
        rm -rf out/packages
        step "packing"
        pack out/packages
        step "packing again, for the same bytes"
        pack out/packages/again
        for package in out/packages/again/*; do cmp "$package" "out/packages/${package##*/}"; done
        rm -r out/packages/again
        step "trying them"
        tests/interface/packages.sh out/packages "${2:-}"
        step "done: out/packages/"
        ;;
    demo)
        build release programs
        for scene in probe_on_liver kidney_on_liver wrl_pair; do
            step "running $scene"
            build/release/trocar run "content/scenes/$scene.toml" --out "out/demo/$scene"
        done
        step "done: open out/demo/*/report.html, look at out/demo/*/frames/, load out/demo/*/trace.json in a trace viewer"
        ;;
    *) usage; [ -n "${1:-}" ] && exit 2 || exit 0 ;;
esac
