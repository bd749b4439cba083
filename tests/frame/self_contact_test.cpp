#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cstring>
#include <fstream>
#include <numeric>

#include "frame/written_scene.hpp"
#include "systems/output/self_crossings.hpp"
#include "tests/reference/folded_sheet.hpp"

// Surfaces touch themselves, and sheets each other, without crossing.
namespace trocar {
namespace {

using reference::folded_sheet;

struct SheetFile {
    std::filesystem::path path;
    SheetFile(const std::string& name, const Mesh& mesh)
        : path(std::filesystem::temp_directory_path() / ("trocar_" + name + "_" + std::to_string(getpid()) + ".obj")) {
        std::ofstream out(path);
        out.precision(17);
        for (const Vec3d& p : mesh.position) out << "v " << p.x() << ' ' << p.y() << ' ' << p.z() << '\n';
        for (const Triangle& t : mesh.triangle) out << "f " << t[0] + 1 << ' ' << t[1] + 1 << ' ' << t[2] + 1 << '\n';
    }
    SheetFile(const SheetFile&) = delete;
    ~SheetFile() { std::filesystem::remove(path); }
};

// A limp sheet of 0.2 kg/m^2.
std::string sheet_body(const std::string& name, const SheetFile& file, const std::string& keys, const std::string& tissue = "") {
    return "[[body]]\nname = \"" + name + "\"\nfile = \"" + file.path.string() +
           "\"\nscale = 1\nmotion = \"deformable\"\nanchor = \"shape\"\nthickness = 1e-3\n" +
           (keys.find("self_contact") == keys.npos ? "self_contact = true\n" : "") + keys +
           "\n[body.tissue]\nyoungs_modulus = 2e4\ndensity = 200\nwall = 1e-3\ndepth = 1e6\nfriction = 0.3\n" + tissue + "\n";
}
const std::string kTable = "[[body]]\nname = \"table\"\nshape = \"table\"\n";

// Pairs of faces that cross, of all deformable bodies together.
uint64_t crossings(const World& w) {
    std::vector<Triangle> triangle;
    std::vector<Float4> position;
    for (uint32_t body = 0; body < w.bodies.mesh.size(); ++body) {
        if (!is_deformable(w.bodies, body)) continue;
        const MeshView mesh = mesh_view(w.meshes, w.bodies.mesh[body]);
        const auto first = static_cast<uint32_t>(position.size());
        for (const Triangle& t : mesh.triangle) triangle.push_back({first + t[0], first + t[1], first + t[2]});
        for (uint32_t v = 0; v < mesh.position.size(); ++v) {
            const Vec3d p = vertex_position(surfaces_of(w), body, v);
            position.push_back({static_cast<float>(p.x()), static_cast<float>(p.y()), static_cast<float>(p.z()), 0});
        }
    }
    CrossingFacesScratch scratch;
    return count_crossing_faces(triangle, position.data(), scratch);
}

double mass_of(const World& w, uint32_t body) {
    double mass = 0;
    const Range range = w.bodies.particles[body];
    for (uint32_t i = range.first; i < range.end(); ++i)
        if (w.particles.offset[i].w > 0) mass += 1 / double{w.particles.offset[i].w};
    return mass;
}

double mean_height(const World& w, uint32_t body) {
    const uint32_t count = w.meshes.info[w.bodies.mesh[body]].vertices.count;
    double sum = 0;
    for (uint32_t v = 0; v < count; ++v) sum += vertex_position(surfaces_of(w), body, v).z();
    return sum / count;
}

// Three sheets of unlike triangles lie on each other: what each bears is the weight of those above it, and each is a slab of its
// thickness, on the table as on others.
TEST(SelfContact, SheetsOfAStackBearWhatLiesAbove) {
    const SheetFile coarse("coarse", folded_sheet(10, 10, 4e-3, 20, 1e-3, 0, 1)),
        fine("fine", folded_sheet(14, 14, 2.857142857e-3, 20, 1e-3, 0, 1));
    const WrittenScene scene("stack", "[contact]\nrate = 120\n" + kTable +
                                          sheet_body("a", coarse, "position = [0, 0, 0.0106]", "damping = 30") +
                                          sheet_body("b", fine, "position = [0.0003, 0.0002, 0.0117]", "damping = 30") +
                                          sheet_body("c", coarse, "position = [0, 0, 0.0128]", "damping = 30"));
    std::array<double, 2> force{};                              // of a on b, of b on c
    run(scene.build().world, 60, [&](Frame& frame, int pass) {  // later they sleep
        const World& w = frame.world();
        if (pass % 10 == 0) {
            EXPECT_EQ(crossings(w), 0u);
        }
        const ContactConstraints& c = w.contact_constraints;
        for (uint32_t i = 0; pass >= 40 && i < c.body.size(); ++i) {
            const uint32_t low = std::min(c.body[i], c.other[i]), high = std::max(c.body[i], c.other[i]);
            if (low == 0 || low == high) continue;
            ASSERT_EQ(high, low + 1);
            force[low - 1] += (c.body[i] == high ? 1 : -1) * c.impulse[i].z() * 120 / 20;
        }
        if (pass < 59) return;
        const double weight = mass_of(w, 1) * 9.81;
        EXPECT_NEAR(force[0], 2 * weight, 0.02 * weight);
        EXPECT_NEAR(force[1], weight, 0.01 * weight);
        const double thickness = 1e-3;
        double top = -1;
        const MeshView below = mesh_view(w.meshes, w.bodies.mesh[0]);
        for (uint32_t v = 0; v < below.position.size(); ++v) top = std::max(top, vertex_position(surfaces_of(w), 0, v).z());
        for (const uint32_t body : {1u, 2u, 3u})
            EXPECT_NEAR(mean_height(w, body) - top, (body - 0.5) * thickness, 0.01 * body * thickness) << body;
    });
}

// A sheet on another, which is fixed, on a slope: it stays below Coulomb's angle and slides above it, as he says, also fast, over
// edges and rims.
TEST(SelfContact, ASheetSlidesOnAnotherAboveCoulombsAngle) {
    const SheetFile below("below", folded_sheet(60, 14, 4e-3, 400, 1e-3, 0, 1)), above("above", folded_sheet(8, 8, 3.1e-3, 40, 1e-3, 0, 1));
    for (const double share : {0.99, 1.01, 1.5}) {
        const double angle = std::atan(0.3 * share);
        const std::string gravity =
            "gravity = [" + std::to_string(9.81 * std::sin(angle)) + ", 0, " + std::to_string(-9.81 * std::cos(angle)) + "]\n";
        const WrittenScene scene("slope", gravity + "[contact]\nrate = 120\n" + sheet_body("below", below, "fixed_below = 1") +
                                              sheet_body("above", above, "position = [0.02, 0.007, 0.00101]", "damping = 10"));
        std::vector<double> speed;
        run(scene.build().world, 30, [&](Frame& frame, int) {
            const World& w = frame.world();
            const Range range = w.bodies.particles[1];
            double momentum = 0;
            for (uint32_t i = range.first; i < range.end(); ++i)
                if (w.particles.offset[i].w > 0) momentum += w.particles.velocity_x[i] / double{w.particles.offset[i].w};
            speed.push_back(momentum / mass_of(w, 1));
        });
        const double wanted = std::max(0.0, 9.81 * (std::sin(angle) - 0.3 * std::cos(angle))), found = (speed[29] - speed[14]) / 0.125;
        std::printf("slope of %.2f of Coulomb's: %.4f m/s^2, wanted %.4f\n", share, found, wanted);
        EXPECT_NEAR(found, wanted, 0.01 * 0.3 * 9.81);
    }
}

Vec3d velocity_of(const World& w, uint32_t i) { return {w.particles.velocity_x[i], w.particles.velocity_y[i], w.particles.velocity_z[i]}; }

// The halves of a sheet that floats are thrown at each other.
struct ClappingSheet {
    SheetFile file{"clap", folded_sheet(20, 6, 3e-3, 9, 8e-3, 0, 1)};
    WrittenScene scene{"clap", "gravity = [0, 0, 0]\n[contact]\nrate = 240\n" + sheet_body("sheet", file, "", "damping = 0")};
    World world() const {
        World w = scene.build().world;
        const MeshView mesh = mesh_view(w.meshes, w.bodies.mesh[0]);
        for (uint32_t v = 0; v < mesh.position.size(); ++v) {
            w.particles.velocity_z[w.bodies.particles[0].first + v] = mesh.position[v].z() < 4e-3 ? 0.4f : -0.4f;
            w.particles.velocity_y[w.bodies.particles[0].first + v] = static_cast<float>(2 * mesh.position[v].x());
        }
        return w;
    }
};

TEST(SelfContact, KeepsLinearMomentumAndAddsNoEnergy) {
    const ClappingSheet sheet;
    Vec3d start = Vec3d::Zero();
    double first = 0, peak = 0;
    uint64_t contacts = 0, held = 0;
    const World world = sheet.world();
    const Range range = world.bodies.particles[0];
    for (uint32_t i = range.first; i < range.end(); ++i)
        if (const Vec3d v = velocity_of(world, i); world.particles.offset[i].w > 0)
            start += v / double{world.particles.offset[i].w}, first += 0.5 * v.squaredNorm() / double{world.particles.offset[i].w};
    run(sheet.world(), 48, [&](Frame& frame, int) {
        const World& w = frame.world();
        EXPECT_EQ(crossings(w), 0u);
        Vec3d now = Vec3d::Zero();
        double size = 0;
        for (uint32_t i = range.first; i < range.end(); ++i)
            if (w.particles.offset[i].w > 0)
                now += velocity_of(w, i) / double{w.particles.offset[i].w},
                    size += velocity_of(w, i).norm() / double{w.particles.offset[i].w};
        EXPECT_LT((now - start).norm(), 1e-5 * size);
        peak = std::max(peak, w.energy.kinetic + w.energy.elastic + w.energy.bending);
        contacts = w.report.self_contacts, held = w.report.held_vertices;
    });
    std::printf("clap: energy %.4g J, at most %.4g, %zu contacts, %zu held\n", first, peak, size_t(contacts), size_t(held));
    EXPECT_GT(contacts, 200u);
    EXPECT_LT(peak, 1.001 * first);
}

// What contact changes of the angular momentum is little beside the sum of its sizes over the particles: nothing, but for position
// corrections, without friction; with it, the couple of two opposite forces a thickness apart.
TEST(SelfContact, KeepsAngularMomentum) {
    for (const double friction : {0.0, 0.3}) {
        const ClappingSheet sheet;
        World world = sheet.world();
        world.bodies.tissue[0].friction = friction;
        const Range range = world.bodies.particles[0];
        const auto angular_momentum = [&](const World& w, double& size) {
            Vec3d sum = Vec3d::Zero();
            size = 0;
            for (uint32_t i = range.first; i < range.end(); ++i) {
                const Float4& p = w.particles.offset[i];
                if (!(p.w > 0)) continue;
                const Vec3d one = Vec3d(p.x, p.y, p.z).cross(velocity_of(w, i)) / double{p.w};
                sum += one, size += one.norm();
            }
            return sum;
        };
        double size = 0, now = 0, most = 0;
        const Vec3d start = angular_momentum(world, size);
        run(std::move(world), 48, [&](Frame& frame, int) { most = std::max(most, (angular_momentum(frame.world(), now) - start).norm()); });
        std::printf("clap with friction %.1f: angular momentum changes by %.3g of the sum of its sizes\n", friction, most / size);
        EXPECT_LT(most, (friction > 0 ? 0.005 : 0.001) * size);
    }
}

// A sheet dropped on its edge crumples: it crosses itself without self-contact, and nowhere with it, pass by pass.
TEST(SelfContact, ASheetThatCrumplesDoesNotCrossItself) {
    Mesh upright = folded_sheet(24, 12, 3e-3, 40, 1e-3, 1e-4, 1);
    for (Vec3d& p : upright.position) p = Vec3d(p.x(), p.z() + 2e-3 * std::sin(200 * p.y()), p.y() + 2e-3);
    const SheetFile file("upright", upright);
    for (const bool touches : {false, true}) {
        const WrittenScene scene("upright", "[contact]\nrate = 120\n" + kTable +
                                                sheet_body("sheet", file, touches ? "" : "self_contact = false", "damping = 10"));
        uint64_t most = 0, last = 0;
        run(scene.build().world, 90, [&](Frame& frame, int) { most = std::max(most, last = crossings(frame.world())); });
        if (touches)
            EXPECT_EQ(most, 0u);
        else
            EXPECT_GT(most, 20u);
    }
}

// The same bits for any number of threads and without any scratch.
TEST(SelfContact, GivesTheSameBitsForAnyNumberOfThreads) {
    const ClappingSheet sheet;
    const auto hash_of = [&](uint32_t threads, bool clear) {
        ThreadPool pool(threads);
        uint64_t hash = 0;
        pool.run([&] {
            FrameOptions options;
            options.clear_scratch = clear;
            Frame frame(sheet.world(), options);
            for (int pass = 0; pass < 30; ++pass) frame.step();
            EXPECT_FALSE(frame.world().self_contacts.body.empty());
            hash = state_hash(frame.world());
        });
        return hash;
    };
    const uint64_t one = hash_of(1, false);
    for (const uint32_t threads : {2u, 3u, 8u}) EXPECT_EQ(hash_of(threads, false), one) << threads;
    EXPECT_EQ(hash_of(2, true), one);
}

// A surface that is nowhere near itself moves as it does without self-contact, to the bit: a sheet that falls, a ball that bounces
// on a table. (A sheet with self-contact lies half its thickness above others.)
TEST(SelfContact, ChangesNothingWhereNothingIsNear) {
    const SheetFile file("drape", folded_sheet(16, 16, 4e-3, 40, 1e-3, 3e-4, 1));
    const std::string ball =
        "[[body]]\nname = \"ball\"\nshape = \"sphere\"\ntriangles = 400\nsize = 0.1\nmotion = \"deformable\"\nanchor = "
        "\"shape\"\nposition = [0.2, 0, 0.06]\nKEYS[body.tissue]\nyoungs_modulus = 1e5\n";
    struct Seen {
        std::vector<Float4> offset;
        std::vector<float> velocity;
        uint64_t contacts = 0, near = 0;
    };
    const auto fall = [&](const std::string& keys) {
        std::string text = kTable + sheet_body("sheet", file, "position = [0, 0, 0.3]\n" + keys) + ball;
        text.replace(text.find("KEYS"), 4, keys);
        Seen seen;
        run(WrittenScene("drape", text).build().world, 12, [&](Frame& frame, int) {
            const World& w = frame.world();
            seen.offset.assign(w.particles.offset.begin(), w.particles.offset.end());
            seen.velocity.assign(w.particles.velocity_z.begin(), w.particles.velocity_z.end());
            for (const Vec3d& impulse : w.contact_constraints.impulse) seen.contacts += impulse.z() != 0;
            seen.near = w.report.self_contacts;
        });
        return seen;
    };
    const Seen with = fall("self_contact = true\n"), without = fall("self_contact = false\n");
    EXPECT_GT(with.contacts, 10u);
    EXPECT_EQ(with.near, 0u);
    EXPECT_EQ(with.contacts, without.contacts);
    ASSERT_EQ(with.offset.size(), without.offset.size());
    EXPECT_EQ(std::memcmp(with.offset.data(), without.offset.data(), with.offset.size() * sizeof(Float4)), 0);
    EXPECT_EQ(with.velocity, without.velocity);
}

TEST(SelfContact, IsForDeformableBodies) {
    const WrittenScene rigid("rigid", kTable + "self_contact = true\n"), word("word", kTable + "self_contact = \"yes\"\n");
    EXPECT_NE(rigid.error().find("only a deformable body has self_contact"), std::string::npos) << rigid.error();
    EXPECT_NE(word.error().find("self_contact"), std::string::npos) << word.error();
    const WrittenScene fine("fine", kTable + "self_contact = false\n");
    EXPECT_EQ(fine.error(), "");
    EXPECT_TRUE(fine.build().world.bodies.self_contact.empty());
}

}  // namespace
}  // namespace trocar
