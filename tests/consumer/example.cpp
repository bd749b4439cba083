#include <cmath>
#include <cstdio>
#include <string>
#include <trocar/content/scene/build_scene.hpp>
#include <trocar/content/scene/make_prototype.hpp>
#include <trocar/content/shapes/shape_library.hpp>
#include <trocar/engine/base/error.hpp>
#include <trocar/engine/jobs/thread_pool.hpp>
#include <trocar/systems/frame/frame.hpp>
#include <utility>

using namespace trocar;

// A soft ball above a table. Metres, kilograms, seconds.
World make_world() {
    World w;
    const Prototype table = make_prototype(w.meshes, make_shape("table", 1000), {});
    const Prototype ball = make_prototype(w.meshes, make_shape("sphere", 1000), {.scale = 0.1});
    if (table.row == kNone || ball.row == kNone) throw InputError("refused: " + table.judgement.reason + ball.judgement.reason);
    add_body(w, "table", table.row, Motion::kStatic);
    const uint32_t body = add_body(w, "ball", ball.row, Motion::kDeformable, {.youngs_modulus = 20e3}, AnchorFrame::kShape);
    w.poses.origin[body] = Vec3d(0, 0, 0.07);
    make_deformable(w, body);  // at its present position; a rigid body that falls: Motion::kFree and set_rigid_mass
    make_trees(w);             // after all bodies
    return w;
}

void run() {
    World start = make_world();  // or build_scene(read_scene_file("scene.toml")).world
    if (const std::string fault = find_fault(start); !fault.empty()) throw InputError(fault);
    Frame frame(std::move(start), {});
    const World& w = frame.world();
    for (int pass = 0; pass < 100; ++pass) frame.step();
    std::printf("after %.2f s the first vertex of \"%s\" is at z = %.4f m\n", static_cast<double>(w.clock.tick) * 1e-3,
                w.bodies.name[1].c_str(), vertex_position(surfaces_of(w), 1, 0).z());
    for (size_t i = 0; i < w.contacts.point.size() && i < 3; ++i)
        std::printf("%s touches %s, %.4f mm apart\n", w.bodies.name[w.contacts.body[i]].c_str(), w.bodies.name[w.contacts.other[i]].c_str(),
                    1e3 * w.contacts.distance[i]);
    if (!(std::abs(w.energy.balance) < 1e-3)) throw InputError("the energy does not balance");  // J
    if (w.report.nonfinite_particles + w.report.runaway_bodies > 0) throw InputError("something had to be restored");
}

int main() {
    try {
        ThreadPool pool(0);  // all cores
        pool.run(run);
    } catch (const InputError& e) {
        std::fprintf(stderr, "%s\n", e.what());
        return 2;
    }
}
