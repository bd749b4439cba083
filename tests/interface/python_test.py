"""The Python module over the shared library: what it shows is what the program and the C interface have."""

import ctypes
import gc
import json
import os
import subprocess
import sys
import tempfile
import threading
import unittest
from pathlib import Path

import trocar
from trocar import _c

try:
    import numpy as np
except ImportError:
    np = None

PROGRAM, SOURCE = os.environ["TROCAR_PROGRAM"], Path(os.environ["TROCAR_SOURCE"])
SCENE = (SOURCE / "tests/interface/ball.toml").read_text()
needs_numpy = unittest.skipIf(np is None, "numpy is not installed (python3-numpy)")


class Worlds(unittest.TestCase):
    def test_the_hash_is_that_of_the_program(self):
        with tempfile.TemporaryDirectory() as folder:
            words = ["ball.tissue.youngs_modulus=15000", "ball.triangles=300"]
            sets = [x for word in words for x in ("--set", word)]
            subprocess.run([PROGRAM, "run", SOURCE / "tests/interface/ball.toml", "--seconds", "0.5", "--no-render", "--no-player", "--out",
                            folder, *sets], check=True, capture_output=True)
            metrics = json.loads((Path(folder) / "metrics.json").read_text())
        with trocar.Sim(SOURCE / "tests/interface/ball.toml", set={"ball.tissue.youngs_modulus": 15000, "ball.triangles": 300}) as sim:
            sim.step_until(0.5)
            self.assertEqual(sim.hash, metrics["state_hash"])

    def test_errors_have_file_and_line(self):
        with self.assertRaises(trocar.InputError) as raised:
            trocar.Sim("mine.toml", text="[[body]]\nname = \"a\"\nshape = 5\n")
        error = raised.exception
        self.assertEqual((error.file, error.line, error.column), ("mine.toml", 3, 9))
        self.assertEqual(str(error), "mine.toml:3:9: shape must be a string")
        self.assertIsInstance(error, ValueError)
        with self.assertRaisesRegex(trocar.InputError, "did you mean \"palpate\""):
            trocar.Sim("palpat")
        with trocar.Sim(text=SCENE) as sim:
            with self.assertRaisesRegex(trocar.CallError, "no body is named \"bal\"; there are table, ball, probe"):
                sim.body("bal")
            with self.assertRaisesRegex(trocar.CallError, "no array is named"):
                sim.array("particles.offsets")

    def test_states_go_back_and_forth(self):
        with trocar.Sim(text=SCENE) as sim:
            start = sim.hash
            sim.step(5)
            state, hash_then = sim.state(), sim.hash
            sim.tool().set_target((0, 0, 0.11), seconds=0.1)
            sim.step(10)
            after = sim.hash
            sim.restore(state)
            self.assertEqual(sim.hash, hash_then)
            sim.tool().set_target((0, 0, 0.11), seconds=0.1)
            sim.step(10)
            self.assertEqual(sim.hash, after)
            with self.assertRaises(trocar.InputError):
                sim.restore(state[:-1])
            sim.reset()
            self.assertEqual((sim.hash, sim.time), (start, 0))

    def test_use_after_close_is_an_error(self):
        sim = trocar.Sim(text=SCENE)
        body, tool, view = sim.body("ball"), sim.tool(), sim.array("particles.offset")
        sim.close()
        sim.close()
        for use in (lambda: sim.step(), lambda: sim.hash, lambda: sim.array("clock.tick"), body.vertices, lambda: tool.force,
                    lambda: sim.bodies, lambda: sim.time):
            with self.assertRaises(trocar.ClosedError):
                use()
        if np is not None:
            for use in (lambda: view[0], lambda: view + 1, lambda: view.sum(), lambda: list(view), lambda: np.linalg.norm(view),
                        view.copy, lambda: view.__setitem__(0, 1)):
                with self.assertRaises(trocar.ClosedError):
                    use()
            self.assertEqual(repr(view), "<view of a closed world>")
        # memory lives as long as a view of it: what numpy reads past our checks is there
        before = bytes(memoryview(np.ndarray.view(view, np.ndarray) if np is not None else view))
        del sim, body, tool
        gc.collect()
        self.assertEqual(bytes(memoryview(np.ndarray.view(view, np.ndarray) if np is not None else view)), before)

    def test_worlds_are_freed(self):
        freed = []
        sim = trocar.Sim(text=SCENE)
        free, owner = sim._owner._free, sim._owner
        owner._free = lambda pointer: (freed.append(pointer), free(pointer))
        view = sim.array("poses.origin")
        sim.close()
        del owner
        gc.collect()
        self.assertEqual(freed, [])
        del view
        gc.collect()
        self.assertEqual(len(freed), 1)

    @needs_numpy
    def test_a_view_is_the_present_state_without_a_copy(self):
        with trocar.Sim(text=SCENE) as sim:
            offset, before = sim["particles.offset"], sim["particles.offset"].copy()
            self.assertEqual((offset.dtype, offset.shape[1], sim.unit("particles.offset")), (np.float32, 4, "m"))
            sim.step(10)
            self.assertFalse(np.array_equal(offset, before))
            again = sim["particles.offset"]
            self.assertTrue(np.shares_memory(offset, again))
            ball = sim.body("ball")
            rows = offset[ball.particles][: len(ball.vertices())]
            np.testing.assert_array_equal(ball.vertices(), ball.origin + rows[:, :3].astype(float))
            velocity = sim["particles.velocity_z"]
            velocity[ball.particles] = 0.25
            self.assertTrue((sim["particles.velocity_z"][ball.particles] == 0.25).all())
            with self.assertRaises(ValueError):
                sim["bodies.mesh"][0] = 1
            contacts = sim["contacts.distance"]
            with self.assertRaises(ValueError):
                contacts[:] = 0
            self.assertEqual(len(contacts), len(sim.contacts()))

    @needs_numpy
    def test_every_array_is_that_of_a_capture(self):
        with tempfile.TemporaryDirectory() as folder, trocar.Sim(text=SCENE) as sim:
            sim.step(6)
            file = Path(folder) / "six.cap"
            sim.record(file)
            state = {name: sim.array(name).tobytes() for name in ("particles.offset", "poses.origin", "particles.velocity_x", "clock.tick")}
            sim.step(4)
            sim.record(None)
            raw = self.first_state(file, folder)
            for name, there in state.items():
                self.assertIn(there, raw, name)
            said = subprocess.run([PROGRAM, "replay", file], check=True, capture_output=True, text=True).stdout
            self.assertIn("4", said)

    @staticmethod
    def first_state(file, folder) -> bytes:
        """The unpacked state record: the third of a capture (header, scene, state), zstd."""
        data = Path(file).read_bytes()
        at = data.index(b"state\0\0\0")
        stored, unpacked = (int.from_bytes(data[at + k : at + k + 8], "little") for k in (8, 16))
        zstd = ctypes.CDLL("libzstd.so.1")
        zstd.ZSTD_decompress.restype = ctypes.c_size_t
        out = ctypes.create_string_buffer(unpacked)
        got = zstd.ZSTD_decompress(out, ctypes.c_size_t(unpacked), data[at + 32 : at + 32 + stored], ctypes.c_size_t(stored))
        assert got == unpacked, got
        return out.raw

    def test_tools_and_distances(self):
        with trocar.Sim(text=SCENE) as sim:
            self.assertEqual((sim.bodies, sim.tools), (["table", "ball", "probe"], ["probe"]))
            self.assertEqual([sim.body(b).motion for b in sim.bodies], ["static", "deformable", "hand"])
            tool = sim.tool("probe")
            tool.set_target((0, 0, 0.1), seconds=0.2)
            sim.step_until(0.5)
            self.assertEqual(tool.touched, "ball")
            self.assertGreater(tool.force[2], 0.1)
            self.assertEqual(tuple(tool.device), (0, 0, 0.1))
            with self.assertRaisesRegex(trocar.InputError, "faster than a hand moves"):
                tool.set_target((1, 0, 0.11))
            top = sim.distance("ball", [(0, 0, 0.3), (0, 0, 0.06)])
            self.assertGreater(top[0], 0.15)
            self.assertLess(top[1], -0.03)
            self.assertEqual(sim.body("probe").mass, 0.05)

    def test_a_picture(self):
        with trocar.Sim(text=SCENE) as sim:
            picture = sim.picture(96, 64, plain=True)
            self.assertEqual(tuple(picture.shape), (64, 96, 3))
            self.assertGreater(max(bytes(picture)) - min(bytes(picture)), 60)

    def test_a_forked_child_is_told(self):
        with trocar.Sim(text=SCENE) as sim:
            sim.step()
            child = os.fork()
            if child == 0:
                try:
                    sim.step()
                except trocar.CallError as error:
                    os._exit(0 if "spawn" in str(error) else 2)
                os._exit(1)
            self.assertEqual(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), 0)
            sim.step()

    def test_other_threads_run_during_a_step(self):
        with trocar.Sim(text=SCENE) as sim:
            stop, counted = threading.Event(), [0]

            def count():
                while not stop.is_set():
                    counted[0] += 1

            other = threading.Thread(target=count)
            other.start()
            before = counted[0]
            trocar._c.lib.trocar_step(sim._handle, 30)
            during = counted[0] - before
            stop.set()
            other.join()
            self.assertGreater(during, 100)


class Batches(unittest.TestCase):
    def test_worlds_of_a_batch_are_single_worlds(self):
        hashes = []
        for i in range(4):
            with trocar.Sim(text=SCENE) as sim:
                sim.tool().set_target((0.001 * i, 0, 0.1), seconds=0.2)
                sim.step(20)
                hashes.append(sim.hash)
        with trocar.Batch(text=SCENE, n=4) as batch:
            self.assertEqual(len(batch), 4)
            for i, world in enumerate(batch):
                world.tool().set_target((0.001 * i, 0, 0.1), seconds=0.2)
            batch.keep("contacts.distance")
            batch.step(12)
            batch.step(8)
            self.assertEqual([world.hash for world in batch], hashes)
            self.assertEqual(len(set(hashes)), 4)
            self.assertEqual(len(batch.arrays("contacts.distance")), 4)
            self.assertEqual(len(batch.arrays("particles.offset")[3]), len(batch[3].array("particles.offset")))
            state = batch[1].state()
            batch[2].restore(state)
            self.assertEqual(batch[2].hash, hashes[1])
            each, shared = batch.memory
            self.assertLess(each, 1.2 * len(state))
            world = batch[0]
        with self.assertRaises(trocar.ClosedError):
            world.hash
        with self.assertRaises(trocar.ClosedError):
            batch.step()


    @needs_numpy
    def test_what_sleeps_in_one_world_is_not_what_sleeps_in_another(self):
        """Stages skip bodies that sleep as they were seen last: those of another world, where a thread steps several."""
        scene, moved = SOURCE / "tests/interface/asleep.toml", (0, 0.1)

        def shift(world, x):
            origin = np.array(world["poses.origin"])
            origin[1, 0] += x
            world.put("poses.origin", origin)

        single = [trocar.Sim(scene) for _ in moved]
        with trocar.Batch(scene, 2, threads=1) as batch:
            for i, x in enumerate(moved):
                shift(single[i], x), shift(batch[i], x)
            slept = False
            for _ in range(100):
                batch.step()
                for sim in single:
                    sim.step()
                slept = slept or all(sim["sleep.group"][1] != _c.NONE for sim in single)
            self.assertTrue(slept)
            self.assertEqual([world.hash for world in batch], [sim.hash for sim in single])
        # the probe touched the box of the first world alone
        self.assertGreater(abs(single[0]["poses.origin"][1, 0]), 0.005)
        self.assertLess(abs(single[1]["poses.origin"][1, 0] - 0.1), 0.001)


class Contact(unittest.TestCase):
    TETRAHEDRON = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]

    def value(self, row, name):
        return row[name] if np is not None else getattr(row, name)

    def test_two_tetrahedra(self):
        points, triangles = self.TETRAHEDRON
        moved = [(x + 0.02, y + 0.02, z + 0.9) for x, y, z in points]
        with trocar.Collider([(points, triangles), (moved, triangles)]) as contact:
            self.assertEqual(contact.admission(0), "solid")
            pair = contact.find().pairs()[0]
            self.assertEqual(self.value(pair, "overlap"), 1)
            # the corner (0.02, 0.02, 0.9) is 0.02 deep; (t, t, 0.9) of its face, as far from two faces as from the slanted one, more
            self.assertAlmostEqual(self.value(pair, "surface_depth"), 0.1 / (2 + 3**0.5), delta=2e-4)
            edges = trocar.Collider([(points, triangles), (moved, triangles)], faces=False).find().pairs()[0]
            self.assertAlmostEqual(self.value(edges, "depth"), 0.02, delta=1e-12)
            contact.move(1, [(x, y, z + 0.2) for x, y, z in moved])
            pairs = contact.find().pairs()
            self.assertEqual([p for p in pairs if self.value(p, "overlap")], [])
        with self.assertRaisesRegex(trocar.InputError, "mesh 1, triangle 0: vertex 7 of 4"):
            trocar.Collider([(points, triangles), (points, [(0, 1, 7)])])
        with self.assertRaises(trocar.InputError):
            trocar.Collider([(points, triangles), (points, triangles)]).move(0, points[:3])


@needs_numpy
class Environments(unittest.TestCase):
    def test_palpation_finds_the_lump(self):
        from trocar.envs import Palpation

        env = Palpation(seconds=3, set={"liver.triangles": 1000, "liver.cells": 10})

        def episode(seed):
            seen, info = env.reset(seed=seed)
            self.assertEqual((seen.shape, seen.dtype, info), ((9,), np.float32, {}))
            path = [seen]
            while True:  # go over the lump, then press
                over, soft = np.abs(seen[:2]).max() < 0.05, np.linalg.norm(seen[3:6]) < 3
                seen, reward, done, cut, info = env.step([-3 * seen[0], -3 * seen[1], -1 if over and soft else 0])
                path.append(seen)
                if done or cut:
                    return np.array(path), reward, done, info

        first, reward, done, info = episode(3)
        self.assertTrue(done)
        self.assertGreater(reward, 1)
        self.assertLess(info["away"], 0.012)
        again = episode(3)[0]
        np.testing.assert_array_equal(first, again)
        self.assertFalse(np.array_equal(first[0], episode(4)[0][0]))
        env.reset(seed=1)
        cuts = [env.step([0, 0, 0])[3] for _ in range(90)]  # at rest above: cut after three seconds, less what the start took
        self.assertEqual((cuts[80], cuts[89]), (False, True))
        try:
            from gymnasium.utils.env_checker import check_env
        except ImportError:
            pass
        else:
            check_env(env, skip_render_check=True)
        env.close()
        with self.assertRaises(trocar.ClosedError):
            env.step([0, 0, 0])


class Layout(unittest.TestCase):
    def test_structs_are_those_of_c(self):
        sizes = {}
        for line in (SOURCE / "tests/interface/abi.txt").read_text().splitlines():
            words = line.split()
            if words[0] == "struct":
                sizes[words[1]] = int(words[2])
        self.assertEqual({name: ctypes.sizeof(kind) for name, kind in _c.STRUCTS.items()}, sizes)

    def test_without_numpy(self):
        """Everything but put() works with memoryviews; tried where numpy cannot be imported."""
        if np is None or os.environ.get("TROCAR_NO_NUMPY"):
            return
        code = "import sys; sys.modules['numpy'] = None; import runpy; sys.argv = ['x']; runpy.run_path(%r, run_name='__main__')" % __file__
        done = subprocess.run([sys.executable, "-B", "-c", code], env=dict(os.environ, TROCAR_NO_NUMPY="1"), capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, done.stderr)


if __name__ == "__main__":
    if np is None:
        print("numpy is not installed: its tests are skipped", file=sys.stderr)
    unittest.main()
