"""Runs what a Markdown page shows, in order, in an empty folder: usage: tutorial.py PAGE FOLDER [LEAST]

Files are the blocks whose first line is a comment with a name (`# ball.toml`); `console` blocks hold commands after `$ ` and
what they print; `python` blocks are programs, and an `output` block after one is what it prints. `...` in what is printed stands
for anything, on a line of its own for any number of lines. LEAST: number of commands and programs that the page has at least, 10."""

import os
import re
import shutil
import subprocess
import sys


def blocks(text):
    return [(m[1], m[2]) for m in re.finditer(r"^```(\w+)\n(.*?)^```$", text, re.M | re.S)]


def pattern(expected):
    """Expected lines as a regular expression."""
    lines = ["(?:.*\n)*" if line.strip() == "..." else ".*".join(map(re.escape, line.split("..."))) + "\n"
             for line in expected.splitlines()]
    return re.compile("".join(lines))


def check(what, printed, expected):
    printed = printed if printed.endswith("\n") or not printed else printed + "\n"
    if not pattern(expected).fullmatch(printed):
        sys.exit(f"{what}\nprinted:\n{printed}\nbut the page says:\n{expected}")


def run(what, command):
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=250)
    return done.stdout


def main(page, folder, least=10):
    shutil.rmtree(folder, ignore_errors=True)
    os.makedirs(folder)
    parts = blocks(open(page, encoding="utf-8").read())
    os.chdir(folder)
    ran = 0
    for i, (kind, text) in enumerate(parts):
        if kind == "console":
            for entry in re.split(r"^\$ ", text, flags=re.M)[1:]:
                command, _, expected = entry.partition("\n")
                check("$ " + command, run(command, ["sh", "-c", command]), expected)
                ran += 1
        elif kind == "python":
            printed = run(text, [sys.executable, "-c", text])
            follows = parts[i + 1] if i + 1 < len(parts) else ("", "")
            check(text, printed, follows[1] if follows[0] == "output" else "")
            ran += 1
        elif kind != "output":
            name = re.match(r"# (\S+)\n", text)
            if not name:
                sys.exit(f"a block of kind {kind} without a name: {text[:40]}")
            # the comment stays where the format knows it
            open(name[1], "w", encoding="utf-8").write(text if kind == "toml" else text[name.end():])
    if ran < least:
        sys.exit(f"only {ran} commands: nothing was tested")
    print(f"{page}: {ran} commands do what it says")


main(os.path.abspath(sys.argv[1]), os.path.abspath(sys.argv[2]), *map(int, sys.argv[3:]))
