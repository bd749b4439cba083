"""Draws every scene that comes with the program: usage: gallery.py PROGRAM SCENES FOLDER

Writes FOLDER/SCENE.png, a picture of two thirds of its time (of two seconds at most: the long ones are shortened), and
FOLDER/gallery.md. A scene whose picture is there already is not run again."""

import os
import subprocess
import sys
import tempfile
import tomllib


def picture(program, scene, seconds, png):
    with tempfile.TemporaryDirectory() as out:
        done = subprocess.run([program, "run", scene, "--seconds", str(seconds), "--out", out, "--no-player"], capture_output=True, text=True)
        frames = os.path.join(out, "frames")
        drawn = sorted(os.listdir(frames)) if os.path.isdir(frames) else []
        if not drawn:
            sys.exit(f"{scene}: no picture: {done.stderr}")
        os.replace(os.path.join(frames, drawn[-1]), png)


def main(program, scenes, folder):
    os.makedirs(folder, exist_ok=True)
    names = sorted(name[:-5] for name in os.listdir(scenes) if name.endswith(".toml"))
    page = ["# Scenes", "", "`trocar run NAME` runs each; `trocar scenes` lists their parameters.", ""]
    for i, name in enumerate(names):
        scene = os.path.join(scenes, name + ".toml")
        table = tomllib.load(open(scene, "rb"))
        png = os.path.join(folder, name + ".png")
        print(f"[{i + 1}/{len(names)}] {name}", flush=True)
        if not os.path.exists(png):
            picture(program, scene, min(2.0, 2 / 3 * table.get("seconds", 3)), png)
        page += [f"## {name}", "", table.get("description", table.get("name", "")), "", f"![{name}]({name}.png)", ""]
    open(os.path.join(folder, "gallery.md"), "w", encoding="utf-8").write("\n".join(page))


main(*sys.argv[1:4])
