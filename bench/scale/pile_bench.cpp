// Heaps of free rigid boxes beside rigid-body engines: processor time of one thread, in turn pass by pass, and overlap by one judge.
#include <dlfcn.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <string>

#include "bench/peers/bullet_pile.hpp"
#include "bench/scale/pile.hpp"
#include "content/scene/build_scene.hpp"
#include "content/scene/find_scene.hpp"
#include "engine/base/error.hpp"
#include "engine/geometry/quaternion.hpp"
#include "engine/jobs/thread_pool.hpp"
#include "systems/frame/frame.hpp"
namespace trocar::bench {
namespace {

namespace fs = std::filesystem;

// Where a box is: its middle, and its axes as columns.
struct PlacedBox {
    Vec3d middle, half;
    Eigen::Matrix3d axes;
};

// Depth of two boxes, m: the shortest separating translation along the axes of Gottschalk, Lin and Manocha, "OBBTree" (SIGGRAPH
// 1996), section 5; 0 if they are apart.
double depth_of(const PlacedBox& a, const PlacedBox& b) {
    const Vec3d apart = b.middle - a.middle;
    if (apart.norm() > a.half.norm() + b.half.norm()) return 0;
    double least = std::numeric_limits<double>::infinity();
    const auto ask = [&](const Vec3d& axis) {
        const double length = axis.norm();
        if (length < 1e-9) return;
        const double reach = (a.axes.transpose() * axis).cwiseAbs().dot(a.half) + (b.axes.transpose() * axis).cwiseAbs().dot(b.half);
        least = std::min(least, (reach - std::abs(apart.dot(axis))) / length);
    };
    for (int i = 0; i < 3; ++i) {
        ask(a.axes.col(i));
        ask(b.axes.col(i));
        for (int k = 0; k < 3; ++k) ask(a.axes.col(i).cross(b.axes.col(k)));
    }
    return std::max(0.0, least);
}

// Deepest overlap of each free box with any other, m, where there is any.
std::vector<double> overlaps(const std::vector<PileBox>& boxes, const std::vector<PlacedBox>& placed) {
    std::vector<double> found;
    for (size_t i = 0; i < boxes.size(); ++i) {
        double deepest = 0;
        for (size_t k = 0; boxes[i].free && k < boxes.size(); ++k)
            if (k != i) deepest = std::max(deepest, depth_of(placed[i], placed[k]));
        if (deepest > 0) found.push_back(deepest);
    }
    return found;
}

PlacedBox place(const PileBox& box, const double* pose) {
    const Eigen::Quaterniond turn = Eigen::Quaterniond(pose[6], pose[3], pose[4], pose[5]).normalized();
    return {{pose[0], pose[1], pose[2]}, {box.half[0], box.half[1], box.half[2]}, turn.toRotationMatrix()};
}

// Poses of our boxes as PileEngine::poses gives them. Bodies are cuboids in their own frames.
std::vector<double> poses_of(const World& w) {
    std::vector<double> out;
    for (uint32_t b = 0; b < w.bodies.mesh.size(); ++b) {
        const Quat& q = w.poses.orientation[b];
        const Box& box = w.meshes.info[w.bodies.mesh[b]].box;
        const Vec3d at = w.poses.origin[b] + rotate(q, Vec3d(0.5 * (box.min + box.max)));
        out.insert(out.end(), {at.x(), at.y(), at.z(), q.x, q.y, q.z, q.w});
    }
    return out;
}

std::vector<PileBox> boxes_of(const World& w) {
    std::vector<PileBox> boxes;
    const std::vector<double> pose = poses_of(w);
    for (uint32_t b = 0; b < w.bodies.mesh.size(); ++b) {
        const Box& box = w.meshes.info[w.bodies.mesh[b]].box;
        PileBox made{};
        for (int k = 0; k < 3; ++k) made.half[k] = 0.5 * (box.max[k] - box.min[k]), made.position[k] = pose[7 * b + uint32_t(k)];
        for (int k = 0; k < 4; ++k) made.orientation[k] = pose[7 * b + 3 + uint32_t(k)];
        made.free = w.bodies.motion[b] == Motion::kFree;
        boxes.push_back(made);
    }
    return boxes;
}

// One engine's run.
struct Heap {
    double seconds = 0;        // of a processor
    double worst = 0;          // m
    std::vector<double> last;  // m: overlaps after the last pass
    void judge(const std::vector<PileBox>& boxes, const std::vector<double>& pose) {
        std::vector<PlacedBox> placed;
        for (size_t b = 0; b < boxes.size(); ++b) placed.push_back(place(boxes[b], &pose[7 * b]));
        last = overlaps(boxes, placed);
        for (const double depth : last) worst = std::max(worst, depth);
    }
    double median() {
        std::ranges::sort(last);
        return last.empty() ? 0 : last[last.size() / 2];
    }
};

struct Peer {
    std::string name;
    PileEngine engine;
    uint32_t substeps;
};

// With its usual number of substeps and, for the error of ours, with eight times as many.
void add_peer(const std::string& name, const PileEngine& engine, std::vector<Peer>& out) {
    for (const uint32_t more : {1u, 8u}) out.push_back({name, engine, more * engine.substeps});
}

// The file of that name below a folder, or an empty path.
fs::path find_below(const fs::path& folder, const std::string& name) {
    for (const auto& entry : fs::recursive_directory_iterator(folder, fs::directory_options::skip_permission_denied))
        if (entry.path().filename() == name) return entry.path();
    return {};
}

// Compiles and loads the adapter to an engine whose headers and static library lie below DIR/`folder`. A peer that is not there, or
// does not compile, is a line of the report.
void load_peer(const std::string& name, const fs::path& peers, const std::string& folder, const std::string& headers,
               const std::string& library, const std::string& adapter, std::vector<Peer>& out, Report& report) {
    const auto missing = [&](const std::string& why) {
        report.add({.name = "pile beside " + name, .ours = kNoValue, .unit = "ms/pass", .peer = name, .not_judged = why});
    };
    const fs::path root = peers / folder;
    if (!fs::is_directory(root)) return missing("no folder " + root.string());
    const fs::path built = find_below(root, library);
    if (built.empty()) return missing("no " + library + " below " + root.string() + ": build it, with -fPIC, as its authors say");
    const fs::path made = fs::temp_directory_path() / ("trocar_" + adapter + "_" + std::to_string(getpid()) + ".so");
    // what else the engine was compiled with: Jolt ends a program whose definitions are not those of its library
    const char* flags = std::getenv("TROCAR_PEER_FLAGS");
    const std::string command = "c++ -std=c++20 -O3 -mavx2 -mbmi -mpopcnt -mlzcnt -mf16c -mfma -DNDEBUG -shared -fPIC -w " +
                                std::string(flags ? flags : "") + " -I'" + TROCAR_SOURCE_DIR + "' -I'" + (root / headers).string() +
                                "' '" TROCAR_SOURCE_DIR "/bench/peers/" + adapter + ".cpp' '" + built.string() + "' -lpthread -o '" +
                                made.string() + "'";
    if (std::system(command.c_str()) != 0) return missing("its adapter does not compile: " + command);
    void* loaded = dlopen(made.c_str(), RTLD_NOW | RTLD_LOCAL);
    fs::remove(made);
    if (!loaded) return missing(dlerror());
    const auto engine = reinterpret_cast<PileEngine (*)()>(dlsym(loaded, "pile_engine"));
    if (!engine) return missing(dlerror());
    add_peer(name, engine(), out);
}

// One heap of ours and one of every peer, pass by pass in turn.
void pile_row(uint32_t count, uint32_t seed, uint32_t passes, bool hulls, const std::vector<Peer>& peers, Report& report) {
    std::vector<Override> overrides{
        {"count", std::to_string(count)}, {"seed", std::to_string(seed)}, {"contact.hulls", hulls ? "true" : "false"}};
    if (count > 300)
        overrides.push_back({"columns", "8"}), overrides.push_back({"pen", "2.2"}), overrides.push_back({"left", "-0.85"}),
            overrides.push_back({"right", "0.85"});
    BuiltScene built = build_scene(read_scene_file(scenes_folder() / "stress_pile.toml", overrides));
    Frame frame(std::move(built.world), {});
    const World& w = frame.world();
    const std::vector<PileBox> boxes = boxes_of(w);
    const Vec3d& g = w.settings.gravity;
    const double step = 1.0 / w.clock.contact_rate;
    std::vector<void*> pile;
    for (const Peer& peer : peers) {
        const PileSettings settings{{g.x(), g.y(), g.z()}, 1000, 0.5, step, peer.substeps};
        pile.push_back(peer.engine.make(boxes.data(), uint32_t(boxes.size()), &settings));
    }
    Heap ours;
    std::vector<Heap> theirs(peers.size());
    std::vector<double> pose(7 * boxes.size());
    for (uint32_t pass = 0; pass < passes; ++pass) {
        double start = thread_seconds();
        frame.step();
        ours.seconds += thread_seconds() - start;
        ours.judge(boxes, poses_of(w));
        for (size_t p = 0; p < peers.size(); ++p) {
            start = thread_seconds();
            peers[p].engine.step(pile[p]);
            theirs[p].seconds += thread_seconds() - start;
            peers[p].engine.poses(pile[p], pose.data());
            theirs[p].judge(boxes, pose);
        }
    }
    Row row{.name = "pile, " + std::to_string(count) + " boxes, seed " + std::to_string(seed) + (hulls ? ", hulls" : ""),
            .ours = 1e3 * ours.seconds / passes,
            .unit = "ms/pass",
            .error = 1e3 * ours.worst,
            .error_unit = "mm of overlap, worst",
            .axes = {}};
    char note[240];
    if (peers.empty()) report.add(row);
    for (size_t p = 0; p < peers.size(); ++p) {
        peers[p].engine.destroy(pile[p]);
        row.peer = peers[p].name + ", " + std::to_string(peers[p].substeps) + " substeps";
        row.peer_value = 1e3 * theirs[p].seconds / passes;
        row.peer_error = 1e3 * theirs[p].worst;
        if (hulls) row.goal = Goal::kRatio, row.at_least = count > 300 ? 0.3 : 0.5, row.aim = 1;
        std::snprintf(note, sizeof note, "%u passes of %.1f ms; median overlap at the end %.3f mm, its %.3f; %s", passes, 1e3 * step,
                      1e3 * ours.median(), 1e3 * theirs[p].median(), peers[p].engine.settings);
        row.note = note;
        report.add(row);
    }
}

}  // namespace

void pile_rows(Report& report) {
    report.heading("Piles of free rigid boxes beside rigid-body engines, one thread, processor time");
    std::vector<Peer> found;
#ifdef TROCAR_WITH_BULLET
    add_peer("Bullet", bullet_pile_engine(), found);
#endif
    if (!report.peers().empty()) {
        load_peer("Jolt", report.peers(), "JoltPhysics", "", "libJolt.a", "jolt_pile", found, report);
        load_peer("Box3D", report.peers(), "box3d", "include", "libbox3d.a", "box3d_pile", found, report);
    }
    ThreadPool pool(1);
    pool.run([&] {
        for (uint32_t seed = 1; seed <= (report.quick() ? 1u : 3u); ++seed)
            for (const bool hulls : {false, true}) pile_row(100, seed, report.quick() ? 75 : 240, hulls, found, report);
        if (!report.quick()) pile_row(1000, 1, 120, true, found, report);
    });
}

}  // namespace trocar::bench
