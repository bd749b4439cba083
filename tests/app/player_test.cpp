#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <numbers>
#include <random>

#include "engine/files/image_file.hpp"
#include "engine/files/text_file.hpp"
#include "engine/files/whole_file.hpp"
#include "engine/jobs/thread_pool.hpp"
#include "engine/mesh/surface_mesh.hpp"
#include "systems/app/player/player_code.hpp"
#include "systems/app/player/player_page.hpp"
#include "systems/app/report/report_page.hpp"
#include "systems/app/run/live_run.hpp"
#include "systems/frame/state.hpp"
#include "tests/app/quick_scene.hpp"
#include "tests/app/run_program.hpp"
#include "tests/frame/scenes_under_test.hpp"
#include "tests/frame/written_scene.hpp"
namespace trocar {
namespace {

// Reads a recording as page/data.js does, from the description of the format and not with the recorder's code.
struct Decoded {
    struct Contact {
        uint64_t body, other, vertex;
        Vec3d point, normal;
        double distance, push = 0, friction = 0;
        bool constrained;
    };
    struct Moment {
        double time = 0;
        uint64_t pass = 0;
        std::vector<std::vector<double>> at;  // per body, times its step; of a pose seven numbers
        std::vector<uint64_t> state;
        std::vector<std::vector<uint64_t>> corners;  // per body
        std::vector<Contact> contact;
        std::vector<std::array<Vec3d, 2>> link;
        uint64_t contacts_found = 0, cells = 0;
        std::array<uint64_t, 5> inspected{};  // pairs of boxes, of triangles, near vertices, constraints, of them that push
        std::vector<std::array<Vec3d, 2>> box;
        struct Pair {
            uint64_t a, b, triangles, vertices, contacts, constraints;
            double depth, force;
        };
        std::vector<Pair> pair;
        std::vector<std::array<uint64_t, 2>> island;  // bodies, constraints
        std::vector<std::vector<Vec3d>> line;         // m, from the origin
        std::vector<Vec3d> ball, puff;
        std::vector<double> radius, extinction;                       // m, of lines, then of balls; m^2, of puffs
        std::map<uint64_t, std::vector<std::array<double, 4>>> film;  // per body and vertex: thickness, rise, level, blood
        std::map<uint64_t, std::vector<double>> burnt;                // likewise
        double stages_us = 0, cost_us = 0;
    };
    nlohmann::json header;
    std::vector<uint64_t> vertices;  // per mesh
    std::vector<std::vector<double>> shape;
    std::vector<std::vector<uint64_t>> corners;
    std::vector<Moment> moment;
};

class Reading {
 public:
    explicit Reading(const std::vector<uint8_t>& bytes) : bytes_(bytes) {}
    uint64_t number() {
        uint64_t value = 0, scale = 1;
        for (;; scale *= 128) {
            const uint8_t byte = bytes_.at(at_++);
            value += (byte % 128) * scale;
            if (byte < 128) return value;
        }
    }
    double signed_number() {
        const uint64_t v = number();
        return v % 2 == 1 ? -static_cast<double>(v / 2) - 1 : static_cast<double>(v / 2);
    }
    template <typename T, typename Bits>
    double bits() {
        Bits all = 0;
        for (size_t i = 0; i < sizeof(Bits); ++i) all |= Bits{bytes_.at(at_++)} << 8 * i;
        return static_cast<double>(std::bit_cast<T>(all));
    }
    double real() { return bits<float, uint32_t>(); }
    double long_real() { return bits<double, uint64_t>(); }
    std::string text(size_t length) {
        const auto from = bytes_.begin() + static_cast<ptrdiff_t>(at_);
        at_ += length;
        return {from, from + static_cast<ptrdiff_t>(length)};
    }
    std::vector<uint64_t> corners() {
        std::vector<uint64_t> out(3 * number());
        double before = 0;
        for (uint64_t& c : out) before += signed_number(), c = static_cast<uint64_t>(before);
        return out;
    }
    bool at_end() const { return at_ == bytes_.size(); }

 private:
    const std::vector<uint8_t>& bytes_;
    size_t at_ = 0;
};

void decode_contacts(Reading& r, const nlohmann::json& header, Decoded::Moment& m) {
    m.contacts_found = r.number();
    m.contact.resize(r.number());
    const auto column = [&](const auto& put) {
        double value = 0;
        for (Decoded::Contact& c : m.contact) put(c, value += r.signed_number());
    };
    column([](Decoded::Contact& c, double v) { c.body = static_cast<uint64_t>(v); });
    column([](Decoded::Contact& c, double v) { c.other = static_cast<uint64_t>(v); });
    column([](Decoded::Contact& c, double v) { c.vertex = static_cast<uint64_t>(v); });
    for (int skipped = 0; skipped < 2; ++skipped) column([](Decoded::Contact&, double) {});
    for (int k = 0; k < 3; ++k) column([&](Decoded::Contact& c, double v) { c.point[k] = v * header["point_step"].get<double>(); });
    for (int k = 0; k < 3; ++k) column([&](Decoded::Contact& c, double v) { c.normal[k] = v / 127; });
    column([&](Decoded::Contact& c, double v) { c.distance = v * header["depth_step"].get<double>(); });
    column([&](Decoded::Contact& c, double v) { c.constrained = v == 1; });
    column([&](Decoded::Contact& c, double v) { c.push = v * header["force_step"].get<double>(); });
    column([&](Decoded::Contact& c, double v) { c.friction = v * header["force_step"].get<double>(); });
}

std::vector<double> decode_sparse(Reading& r) {
    std::vector<double> values(r.number());
    for (size_t v = 0; v < values.size(); ++v) {
        values[v] = static_cast<double>(r.number());
        if (values[v] == 0) v += r.number();
    }
    return values;
}

void decode_effects(Reading& r, const nlohmann::json& header, Decoded::Moment& m) {
    const double step = header["point_step"], film_step = header["effects"]["film_step"], rise_step = header["effects"]["rise_step"];
    Vec3d at = Vec3d::Zero();
    const auto place = [&] {
        for (double& x : at) x += r.signed_number() * step;
        return at;
    };
    m.line.resize(r.number());
    for (auto& line : m.line) {
        line.resize(r.number());
        m.radius.push_back(r.real()), r.text(3);
        for (Vec3d& point : line) point = place();
    }
    for (uint64_t balls = r.number(); balls > 0; --balls) m.ball.push_back(place()), m.radius.push_back(r.real()), r.text(3);
    for (uint64_t puffs = r.number(); puffs > 0; --puffs) m.puff.push_back(place()), r.real(), m.extinction.push_back(r.real());
    for (uint64_t bodies = r.number(); bodies > 0; --bodies) {
        auto& film = m.film[r.number()];
        for (const double steps : decode_sparse(r)) film.push_back({steps * film_step, 0, 0, 0});
        for (auto& vertex : film)
            if (vertex[0] > 0) vertex[1] = r.signed_number() * rise_step;
        for (const size_t column : {2u, 3u})
            for (auto& vertex : film)
                if (vertex[0] > 0) vertex[column] = static_cast<uint8_t>(r.text(1)[0]) / 255.0;
    }
    for (uint64_t bodies = r.number(); bodies > 0; --bodies) {
        auto& burnt = m.burnt[r.number()];
        for (const double share : decode_sparse(r)) burnt.push_back(share / 255);
    }
}

void decode_findings(Reading& r, const nlohmann::json& header, Decoded::Moment& m) {
    r.number();  // bytes
    for (uint64_t stages = r.number(); stages > 0; --stages) m.stages_us += static_cast<double>(r.number());
    for (uint64_t pairs = 4 * r.number(); pairs > 0; --pairs) r.number();
    decode_contacts(r, header, m);
    for (uint64_t tools = 9 * r.number(); tools > 0; --tools) r.real();
    for (uint64_t links = r.number(); links > 0; --links) {
        m.link.emplace_back();
        for (Vec3d& end : m.link.back())
            for (double& x : end) x = r.real();
    }
    if (header.contains("effects")) decode_effects(r, header, m);
    if (!header["cells"]) return;
    m.cells = r.number();
    const uint64_t kept = r.number();
    for (int i = 0; i < 4; ++i) r.real();
    for (uint64_t i = 0; i < 3 * kept; ++i) r.number();
    for (uint64_t& count : m.inspected) count = r.number();
    const auto rows = [&] {
        r.number();  // found
        return r.number();
    };
    m.box.resize(rows()), m.pair.clear(), m.island.clear();
    for (auto& box : m.box)
        for (Vec3d& corner : box)
            for (double& x : corner) x = r.real();
    for (uint64_t pairs = rows(); pairs > 0; --pairs) {
        Decoded::Moment::Pair p{};
        for (uint64_t* value : {&p.a, &p.b, &p.triangles, &p.vertices, &p.contacts, &p.constraints}) *value = r.number();
        p.depth = r.real(), p.force = r.real();
        m.pair.push_back(p);
    }
    for (uint64_t islands = rows(); islands > 0; --islands) m.island.push_back({r.number(), 0}), m.island.back()[1] = r.number();
}

Decoded decode(const std::vector<uint8_t>& bytes) {
    Reading r(bytes);
    Decoded d;
    d.header = nlohmann::json::parse(r.text(r.number()));
    for (size_t mesh = 0; mesh < d.header["meshes"]; ++mesh) {
        d.vertices.push_back(r.number());
        const bool has_shape = r.number() == 1;
        const double step = r.long_real();
        r.real();
        d.shape.emplace_back();
        std::array<double, 3> before{};
        for (uint64_t i = 0; has_shape && i < 3 * d.vertices.back(); ++i)
            d.shape.back().push_back((before[i % 3] += r.signed_number()) * step);
        d.corners.push_back(r.corners());
        r.text(3 * d.vertices.back());
    }
    for (size_t f = 0; f < d.header["frames"]; ++f) {
        Decoded::Moment m = f > 0 ? d.moment.back() : Decoded::Moment{};
        m.time = r.long_real(), m.pass = r.number(), m.cost_us = static_cast<double>(r.number());
        m.at.resize(d.header["bodies"].size()), m.state.resize(m.at.size()), m.corners.resize(m.at.size());
        for (size_t b = 0; b < m.at.size(); ++b) {
            const nlohmann::json& body = d.header["bodies"][b];
            const uint64_t word = r.number();
            m.state[b] = word / 2;
            m.at[b].resize(body["soft"] ? 3 * d.vertices[body["mesh"]] : 7);
            for (size_t i = 0; word % 2 == 1 && i < m.at[b].size(); ++i)
                m.at[b][i] +=
                    r.signed_number() * (i < 3 || body["soft"] ? body["step"].get<double>() : d.header["turn_step"].get<double>());
        }
        for (uint64_t body; (body = r.number()) > 0;) m.corners[body - 1] = r.corners();
        d.moment.push_back(m);
    }
    for (Decoded::Moment& m : d.moment) decode_findings(r, d.header, m);
    EXPECT_TRUE(r.at_end());
    return d;
}

// World positions of all vertices of a decoded body.
std::vector<Vec3d> places(const Decoded& d, const Decoded::Moment& m, size_t b) {
    const nlohmann::json& body = d.header["bodies"][b];
    const std::vector<double>& at = m.at[b];
    const Vec3d origin(d.header["origin"][0], d.header["origin"][1], d.header["origin"][2]);
    std::vector<Vec3d> out;
    for (size_t v = 0; v < d.vertices[body["mesh"]]; ++v) {
        if (body["soft"]) {
            out.push_back(origin + Vec3d(at[3 * v], at[3 * v + 1], at[3 * v + 2]));
            continue;
        }
        const std::vector<double>& s = d.shape[body["mesh"]];
        const Eigen::Quaterniond turn(at[3], at[4], at[5], at[6]);
        out.push_back(origin + Vec3d(at[0], at[1], at[2]) + turn.normalized() * Vec3d(s[3 * v], s[3 * v + 1], s[3 * v + 2]));
    }
    return out;
}

struct Moment {
    double time;
    std::vector<std::vector<Vec3d>> place;  // per body
};

Moment moment_of(const World& w) {
    Moment m{1e-3 * static_cast<double>(w.clock.tick), {}};
    for (uint32_t b = 0; b < w.bodies.mesh.size(); ++b) m.place.push_back(surface_mesh(surfaces_of(w), b).position);
    return m;
}

// Every decoded moment is that of the run, to the promised error: half a step of a soft body, two of a rigid one, whose turn is
// rounded too.
void expect_moments(const Decoded& d, const std::vector<Moment>& run) {
    double worst = 0;
    for (const Decoded::Moment& m : d.moment) {
        const auto same = std::ranges::find_if(run, [&](const Moment& r) { return std::abs(r.time - m.time) < 1e-9; });
        ASSERT_NE(same, run.end()) << m.time;
        for (size_t b = 0; b < m.at.size(); ++b) {
            const std::vector<Vec3d> shown = places(d, m, b);
            ASSERT_EQ(shown.size(), same->place[b].size());
            const double step = d.header["bodies"][b]["step"], most = d.header["bodies"][b]["soft"] ? 0.51 * step : 2 * step;
            for (size_t v = 0; v < shown.size(); ++v) worst = std::max(worst, (shown[v] - same->place[b][v]).cwiseAbs().maxCoeff() / most);
        }
    }
    EXPECT_LE(worst, 1.0);
    EXPECT_GT(worst, 0.1) << "nothing was compared";
}

struct Recorded {
    std::vector<Moment> moments;
    std::vector<uint8_t> coded;
    uint64_t hash = 0, offered = 0;
    size_t bytes = 0, most_bytes_seen = 0, frames = 0;
};

Recorded record(World world, int passes, bool every_pass, size_t most_bytes, bool recorded = true) {
    Recorded out;
    ThreadPool pool(2);
    pool.run([&] {
        Frame frame(std::move(world), {});
        std::optional<PlayerRecorder> recorder;
        if (recorded) recorder.emplace(frame, every_pass, std::span<const uint64_t>{}, most_bytes);
        out.moments.push_back(moment_of(frame.world()));
        for (int i = 0; i < passes; ++i) {
            frame.step();
            if (recorder)
                recorder->after_pass(frame, frame.times().stage_ns), out.most_bytes_seen = std::max(out.most_bytes_seen, recorder->bytes());
            out.moments.push_back(moment_of(frame.world()));
        }
        out.hash = state_hash(frame.world());
        if (!recorder) return;
        out.coded = recorder->coded("balls", {}), out.offered = recorder->offered(), out.frames = recorder->frames().size();
    });
    return out;
}

// Breaks when coordinates drift by what was rounded away, or bodies are mixed up.
TEST(Player, ShowsWhereTheBodiesWere) {
    const Recorded run = record(quick_scene(), 40, false, PlayerRecorder::kMostBytes);
    const Decoded d = decode(run.coded);
    EXPECT_EQ(d.moment.size(), run.offered);
    EXPECT_GE(d.moment.size(), 20u);
    expect_moments(d, run.moments);
    const World w = quick_scene();
    for (uint32_t b = 0; b < w.bodies.mesh.size(); ++b) {
        const Range triangles = w.meshes.info[w.bodies.mesh[b]].triangles;
        const std::vector<uint64_t>& corners = d.corners[d.header["bodies"][b]["mesh"]];
        ASSERT_EQ(corners.size(), 3 * triangles.count);
        for (size_t i = 0; i < corners.size(); ++i) EXPECT_EQ(corners[i], w.meshes.triangle[triangles.first + i / 3][i % 3]);
        EXPECT_EQ(d.header["bodies"][b]["name"], w.bodies.name[b]);
    }
}

// Breaks when a run depends on who watches it.
TEST(Player, ChangesNoBitOfTheRun) {
    const uint64_t without = record(quick_scene(), 30, false, 0, false).hash;
    EXPECT_EQ(record(quick_scene(), 30, false, PlayerRecorder::kMostBytes).hash, without);
    EXPECT_EQ(record(quick_scene(), 30, true, 1).hash, without);
}

// Breaks when frames that go take their steps with them, or memory grows with the run.
TEST(Player, KeepsWithinItsBoundAndStaysRight) {
    const Recorded whole = record(quick_scene(), 80, true, PlayerRecorder::kMostBytes);
    const size_t most = whole.most_bytes_seen / 6;
    const Recorded bounded = record(quick_scene(), 80, true, most);
    EXPECT_EQ(bounded.offered, 81u);
    EXPECT_LT(bounded.frames, 40u);
    EXPECT_GT(bounded.frames, 5u);
    // frames come in while others go, and joined steps are longer
    EXPECT_LT(bounded.most_bytes_seen, most + most / 2);
    const Decoded d = decode(bounded.coded);
    expect_moments(d, bounded.moments);
    EXPECT_EQ(d.moment.front().time, 0);
}

// Contacts are those of the world, and what their constraints push holds the hand's weight: compared with the world's own arrays.
TEST(Player, ShowsContactsAndTheirForces) {
    ThreadPool pool(2);
    pool.run([&] {
        Frame frame(quick_scene(), {});
        PlayerRecorder recorder(frame, true);
        const World& w = frame.world();
        for (int i = 0; i < 30 || (w.penetrations.depth.empty() && i < 100); ++i)
            frame.step(), recorder.after_pass(frame, frame.times().stage_ns);
        ASSERT_FALSE(w.penetrations.depth.empty());
        const Decoded d = decode(recorder.coded("balls", {}));
        const Decoded::Moment& m = d.moment.back();
        ASSERT_GT(m.contact.size(), 3u);
        EXPECT_EQ(m.contacts_found, w.contacts.body.size());
        EXPECT_EQ(m.cells, w.occupancy.cell_key.size());
        EXPECT_GT(m.stages_us, 0);
        // stage by stage: what the world's own arrays hold
        EXPECT_EQ(
            m.inspected,
            (std::array<uint64_t, 5>{
                w.box_pairs.a.size(), w.candidates.triangle.size(), w.near.vertex.size(), w.contact_constraints.contact.size(),
                static_cast<uint64_t>(std::ranges::count_if(w.contact_constraints.impulse, [](const Vec3d& p) { return p.norm() > 0; }))}));
        ASSERT_EQ(m.pair.size(), w.pairs.a.size());
        ASSERT_EQ(m.pair.size(), 1u) << "ball and probe";
        EXPECT_EQ(m.pair[0].a, w.pairs.a[0]);
        EXPECT_EQ(m.pair[0].b, w.pairs.b[0]);
        EXPECT_EQ(m.pair[0].contacts, w.contacts.body.size());
        EXPECT_EQ(m.pair[0].constraints, w.contact_constraints.contact.size());
        EXPECT_GT(m.pair[0].triangles + m.pair[0].vertices, 0u);
        EXPECT_NEAR(m.pair[0].depth, w.penetrations.depth.at(0), 1e-6 * w.penetrations.depth.at(0));
        double forces = 0;
        for (const Vec3d& impulse : w.contact_constraints.impulse) forces += impulse.norm() / (1e-3 * w.clock.period);
        EXPECT_NEAR(m.pair[0].force, forces, 1e-5 * forces);
        ASSERT_EQ(m.island.size(), w.islands.bodies.size());
        EXPECT_EQ(m.island[0][1], w.contact_constraints.contact.size());
        ASSERT_EQ(m.box.size(), w.bodies.mesh.size());
        double deepest = 0, pushed_most = 0;
        for (const Decoded::Moment& any : d.moment) {
            EXPECT_NEAR(any.stages_us, any.cost_us, 60) << "each stage is cut to whole microseconds";
            for (const Decoded::Contact& c : any.contact)
                deepest = std::max(deepest, -c.distance), pushed_most = std::max(pushed_most, c.push);
        }
        EXPECT_NEAR(d.header["limits"]["depth"], std::max(deepest, 1e-6), 1e-8);
        EXPECT_NEAR(d.header["limits"]["push"], pushed_most, 1e-5);
        const Vec3d origin(d.header["origin"][0], d.header["origin"][1], d.header["origin"][2]);
        double pushed = 0, expected = 0;
        for (size_t i = 0; i < m.contact.size(); ++i) {
            const Decoded::Contact& c = m.contact[i];
            EXPECT_EQ(c.body, w.contacts.body[i]);
            EXPECT_EQ(c.other, w.contacts.other[i]);
            EXPECT_EQ(c.vertex, w.contacts.vertex[i][0]);
            EXPECT_LE((c.point + origin - w.contacts.point[i]).cwiseAbs().maxCoeff(), 0.51e-5);
            EXPECT_LE((c.normal - w.contacts.normal[i]).cwiseAbs().maxCoeff(), 0.51 / 127);
            EXPECT_NEAR(c.distance, w.contacts.distance[i], 0.51e-8);
            pushed += c.push;
        }
        const ContactConstraints& all = w.contact_constraints;
        for (size_t i = 0; i < all.contact.size(); ++i)
            if (all.contact[i] < w.contacts.normal.size())
                expected += all.impulse[i].dot(w.contacts.normal[all.contact[i]]) / (1e-3 * w.clock.period);
        EXPECT_NEAR(pushed, expected, 1e-5 * static_cast<double>(m.contact.size()));
        EXPECT_GT(expected, 0.01);
    });
}

// Breaks when a cut leaves no hole, or a hole stays that was cut in a frame that went.
TEST(Player, ShowsWhatCutsRemove) {
    const WrittenScene scene(
        "player_cut",
        "[contact]\nrate = 60\n[[body]]\nname = \"ball\"\nshape = \"sphere\"\ntriangles = 300\nsize = 0.06\nmotion = \"deformable\"\n"
        "model = \"solid\"\ncells = 6\nfixed_below = -0.01\n[[cut]]\nname = \"slab\"\nbody = \"ball\"\ntime = 0.1\n"
        "box = [-0.1, -0.1, 0.0, 0.1, 0.1, 0.012]\n");
    ThreadPool pool(1);
    pool.run([&] {
        Frame frame(scene.build({}).world, {});
        PlayerRecorder recorder(frame, true);
        for (int i = 0; i < 12; ++i) frame.step(), recorder.after_pass(frame, frame.times().stage_ns);
        const Range triangles = frame.world().meshes.info[frame.world().bodies.mesh[0]].triangles;
        const auto check = [&] {
            const Decoded d = decode(recorder.coded("cut", {}));
            EXPECT_TRUE(d.moment.front().corners[0].empty());
            const std::vector<uint64_t>& corners = d.moment.back().corners[0];
            ASSERT_EQ(corners.size(), 3 * triangles.count);
            for (size_t i = 0; i < corners.size(); ++i)
                EXPECT_EQ(corners[i], frame.world().meshes.triangle[triangles.first + i / 3][i % 3]);
        };
        check();
        while (recorder.halve()) check();
        EXPECT_EQ(recorder.frames().size(), 2u);
    });
}

// Two soft balls and a moving rod, linked: the drawn ends are the linked vertices, and the point carried by the rod.
TEST(Player, ShowsLinks) {
    const std::string ball = "shape = \"sphere\"\nsize = 0.1\ntriangles = 300\nmotion = \"deformable\"\nanchor = \"shape\"\n";
    const WrittenScene scene(
        "player_links", "gravity = [0.0, 0.0, 0.0]\n[[body]]\nname = \"a\"\n" + ball + "[[body]]\nname = \"b\"\n" + ball +
                            "position = [0.0, 0.0, 0.102]\n[[body]]\nname = \"rod\"\nshape = \"sphere\"\nsize = 0.02\ntriangles = 100\n"
                            "motion = \"kinematic\"\n[[body.path]]\ntime = 0.0\nposition = [0.0, 0.0, 0.165]\n[[body.path]]\ntime = 1.0\n"
                            "position = [0.0, 0.05, 0.18]\n[[link]]\nbody = \"a\"\nto = \"b\"\nwithin = 0.01\n[[link]]\nbody = \"b\"\n"
                            "to = \"rod\"\nwithin = 0.02\n");
    ThreadPool pool(1);
    pool.run([&] {
        Frame frame(scene.build({}).world, {});
        PlayerRecorder recorder(frame, true);
        for (int i = 0; i < 20; ++i) frame.step(), recorder.after_pass(frame, frame.times().stage_ns);
        const World& w = frame.world();
        const Surfaces s = surfaces_of(w);
        const Decoded d = decode(recorder.coded("links", {}));
        const auto& shown = d.moment.back().link;
        EXPECT_TRUE(d.header["links"]);
        const Vec3d origin(d.header["origin"][0], d.header["origin"][1], d.header["origin"][2]);
        size_t at = 0;
        for (const LinkGroup& g : w.links.group) {
            EXPECT_GT(g.links.count, 0u) << g.name;
            for (uint32_t i = g.links.first; i < g.links.end(); ++i, ++at) {
                ASSERT_LT(at, shown.size());
                const Vec3d far = is_deformable(w.bodies, g.holder) ? vertex_position(s, g.holder, w.links.far_node[i])
                                                                    : frame_to_world(s, g.holder, w.links.point[i]);
                EXPECT_LT((shown[at][0] + origin - vertex_position(s, g.body, w.links.node[i])).norm(), 1e-7);
                EXPECT_LT((shown[at][1] + origin - far).norm(), 1e-7);
            }
        }
        EXPECT_EQ(at, shown.size());
        EXPECT_GE(w.links.group.size(), 2u);
    });
}

// Looks at the newest moment of a recording of a built-in scene, and at its world.
template <typename Look>
void record_effects(const std::string& name, const std::vector<Override>& overrides, int passes, const Look& look) {
    ThreadPool pool(2);
    pool.run([&] {
        Frame frame(build_scene(read_scene_file(source_folder() / "content/scenes" / (name + ".toml"), overrides), Looks::kPlain).world,
                    {});
        PlayerRecorder recorder(frame, true);
        for (int i = 0; i < passes; ++i) frame.step(), recorder.after_pass(frame, frame.times().stage_ns);
        look(decode(recorder.coded(name, {})), frame.world());
    });
}

// A thread goes through its points, to half a step; its knot is a ball.
TEST(Player, ShowsThreads) {
    record_effects("suture", {}, 4, [](const Decoded& d, const World& w) {
        const Decoded::Moment& m = d.moment.back();
        const Vec3d origin(d.header["origin"][0], d.header["origin"][1], d.header["origin"][2]);
        ASSERT_EQ(m.line.size(), 1u);
        const uint32_t count = w.thread_state.count[0];
        ASSERT_EQ(m.line[0].size(), 3 * (count - 1) + 1) << "three rods between two points";
        for (uint32_t i = 0; i < count; ++i) {
            const Vec3d point = w.thread_state.position[w.threads.thread[0].rows.first + i];
            EXPECT_LE((m.line[0][3 * i] + origin - point).cwiseAbs().maxCoeff(), 0.51 * PlayerCoder::kPointStep);
        }
        ASSERT_EQ(m.ball.size(), 1u);
        EXPECT_LE((m.ball[0] - m.line[0][0]).norm(), 1e-12);
        EXPECT_FLOAT_EQ(static_cast<float>(m.radius[1]), static_cast<float>(4 * m.radius[0]));
    });
}

// Films, drops and what coagulated are those of pictures, in the steps that the header tells; of a scene that has none there is nothing.
TEST(Player, ShowsFluids) {
    record_effects("bleed_and_suck", {{"liver.triangles", "1500"}, {"bleeding", "3000.0"}}, 120, [](const Decoded& d, const World& w) {
        const Decoded::Moment& m = d.moment.back();
        const Vec3d origin(d.header["origin"][0], d.header["origin"][1], d.header["origin"][2]);
        const Drops& drops = w.fluid_state.drops;
        ASSERT_EQ(m.ball.size(), drops.volume.size());
        EXPECT_GT(drops.volume.size(), 0u);
        for (size_t i = 0; i < drops.volume.size(); ++i) {
            EXPECT_LE((m.ball[i] + origin - drops.position[i]).cwiseAbs().maxCoeff(), 0.51 * PlayerCoder::kPointStep);
            EXPECT_NEAR(4 * std::numbers::pi / 3 * std::pow(m.radius[i], 3), drops.volume[i], 1e-6 * drops.volume[i]);
        }
        PictureLiquidScratch scratch;
        PictureSnapshot picture;
        picture.body.resize(w.bodies.mesh.size());
        for (size_t b = 0; b < picture.body.size(); ++b) picture.body[b].mesh = w.bodies.mesh[b];
        write_picture_effects(picture_inputs(w, w.normals, scratch), picture);
        double wettest = 0;
        for (uint32_t b = 0; b < picture.body.size(); ++b) {
            const Range range = picture.body[b].liquid;
            ASSERT_EQ(m.film.contains(b), range.count > 0);
            for (uint32_t v = 0; v < range.count; ++v) {
                const Float4& film = picture.liquid[range.first + v];
                const std::array<double, 4>& shown = m.film.at(b).at(v);
                EXPECT_NEAR(shown[0], film.x, 0.51 * PlayerEffects::kFilmStep);
                if (shown[0] == 0) continue;
                EXPECT_NEAR(shown[1], film.y, 0.51 * PlayerEffects::kRiseStep);
                EXPECT_NEAR(shown[2], film.z, 0.51 / 255);
                EXPECT_NEAR(shown[3], film.w, 0.51 / 255);
                wettest = std::max(wettest, shown[0] * shown[3]);
            }
        }
        EXPECT_GT(wettest, 1e-4) << "it bleeds";
        EXPECT_FALSE(decode(record(quick_scene(), 2, false, PlayerRecorder::kMostBytes).coded).header.contains("effects"));
    });
}

TEST(Player, ShowsSmokeAndBurns) {
    record_effects("smoke", {{"liver.triangles", "1500"}}, 210, [](const Decoded& d, const World& w) {
        const Decoded::Moment& m = d.moment.back();
        const Vec3d origin(d.header["origin"][0], d.header["origin"][1], d.header["origin"][2]);
        const Puffs& puffs = w.fluid_state.puffs;
        ASSERT_EQ(m.puff.size(), puffs.mass.size());
        EXPECT_GT(puffs.mass.size(), 0u);
        for (size_t i = 0; i < puffs.mass.size(); ++i) {
            EXPECT_LE((m.puff[i] + origin - puffs.position[i]).cwiseAbs().maxCoeff(), 0.51 * PlayerCoder::kPointStep);
            EXPECT_NEAR(m.extinction[i], w.fluids.params.smoke_extinction * puffs.mass[i], 1e-6 * m.extinction[i]);
        }
        double most = 0;
        for (const auto& [body, shares] : m.burnt) most = std::max(most, std::ranges::max(shares));
        const double damage = std::ranges::max(w.action_state.heat.damage);
        EXPECT_GT(most, 0.5);
        EXPECT_LE(most, 1 - std::exp(-damage) + 0.51 / 255) << "no more than where it is most";
    });
}

// Steps of any size and sign; a body that rests in either or both frames.
TEST(Player, JoinedMovesAreTheSums) {
    std::mt19937 random(7);
    const std::vector<uint32_t> coordinates{7, 0, 30, 7, 300};
    for (int round = 0; round < 50; ++round) {
        std::vector<uint8_t> a, b, both;
        for (const uint32_t count : coordinates) {
            const bool a_moves = random() % 2, b_moves = random() % 2;
            const uint32_t state = random() % 1000;
            put_number(a, (random() % 1000) << 1 | a_moves), put_number(b, state << 1 | b_moves);
            put_number(both, state << 1 | (a_moves || b_moves));
            std::vector<int64_t> sum(count, 0);
            for (std::vector<uint8_t>* out : {a_moves ? &a : nullptr, b_moves ? &b : nullptr}) {
                for (uint32_t i = 0; out && i < count; ++i) {
                    const int64_t step = static_cast<int64_t>(random() >> random() % 32) * (random() % 2 ? 1 : -1);
                    put_signed(*out, step), sum[i] += step;
                }
            }
            for (uint32_t i = 0; (a_moves || b_moves) && i < count; ++i) put_signed(both, sum[i]);
        }
        EXPECT_EQ(join_moves(a, b, coordinates), both);
    }
}

// Breaks when a page grows without bound, or names of bodies and scenes become markup.
TEST(Player, PageIsBoundedAndSafe) {
    if (!has_player()) {
        EXPECT_NE(missing_player_section().find("without the player"), std::string::npos);
        GTEST_SKIP() << "built without Node.js and npm";
    }
    World world = quick_scene();
    world.bodies.name[0] = "<b onclick='x'>&";
    ThreadPool pool(1);
    pool.run([&] {
        Frame frame(std::move(world), {});
        PlayerRecorder recorder(frame, true);
        for (int i = 0; i < 60; ++i) frame.step(), recorder.after_pass(frame, frame.times().stage_ns);
        const std::string whole = player_section(recorder, "</script><script>", {});
        EXPECT_EQ(whole.find("<b onclick"), std::string::npos);
        EXPECT_EQ(whole.find("</script><script>"), std::string::npos);
        EXPECT_NE(whole.find("61 frames"), std::string::npos);
        EXPECT_NE(whole.find("Permission is hereby granted"), std::string::npos) << "the licence of three.js";
        const size_t recording = whole.find("id=\"player-recording\">") + 22;
        const size_t size = whole.find('<', recording) - recording;
        const std::string smaller = player_section(recorder, "", {}, size / 3);
        const size_t again = smaller.find("id=\"player-recording\">") + 22;
        EXPECT_LE(smaller.find('<', again) - again, size / 3);
        EXPECT_NE(smaller.find("of 61, so that it stays below"), std::string::npos);
        const std::string none = player_section(recorder, "", {}, 100);
        EXPECT_EQ(none.find("player-recording"), std::string::npos);
        EXPECT_NE(none.find("Left out"), std::string::npos);
    });
}

// The program as a user runs it: the page of a run and of a capture of it, and a run without.
TEST(Player, IsInReportsAndInPagesOfCaptures) {
    const std::filesystem::path folder = std::filesystem::path(testing::TempDir()) / "trocar_player";
    std::filesystem::remove_all(folder);
    std::filesystem::create_directories(folder);
    const std::string scene =
        "run probe_on_liver --no-render --seconds 0.5 --set liver.triangles=600 --set probe.triangles=300 --threads 1 ";
    ASSERT_EQ(run_program(scene + "--capture 20-29 --out with", folder, folder).code, 0);
    ASSERT_EQ(run_program(scene + "--no-player --out without", folder, folder).code, 0);
    ASSERT_EQ(run_program("capture export with/captures/passes_20-29.cap --html cap.html", folder, folder).code, 0);
    const auto hash = [&](const char* run) {
        return nlohmann::json::parse(read_text_file(folder / run / "metrics.json"))["state_hash"].get<std::string>();
    };
    EXPECT_EQ(hash("with"), hash("without"));
    const std::string with = read_text_file(folder / "with/report.html"), without = read_text_file(folder / "without/report.html"),
                      capture = read_text_file(folder / "cap.html");
    EXPECT_EQ(without.find("3D player"), std::string::npos);
    EXPECT_EQ(without.find("id=\"player\""), std::string::npos);
    EXPECT_NE(capture.find("Captured by trocar"), std::string::npos);
    for (const std::string& page : {with, capture}) {
        EXPECT_EQ(page.find("id=\"player-recording\"") != std::string::npos, has_player());
        EXPECT_EQ(page.find("built without the player") != std::string::npos, !has_player());
        EXPECT_EQ(page.find(" src=\"http"), std::string::npos);
    }
    if (!has_player()) return;
    EXPECT_NE(with.find("16 frames"), std::string::npos) << "at 0 s and thirty a second";
    EXPECT_NE(capture.find("10 frames"), std::string::npos) << "every pass";
    EXPECT_EQ(run_program("capture export with/captures/passes_20-29.cap --html with/captures/passes_20-29.cap", folder, folder).code, 2);
}

// A run is made a page of from its folder, also when it left none, and a capture from its file; both tell what does not fit.
TEST(Player, IsMadeOfRunsAndCapturesAfterwards) {
    if (!has_player()) GTEST_SKIP() << "built without Node.js and npm";
    const std::filesystem::path folder = std::filesystem::path(testing::TempDir()) / "trocar_view_recording";
    std::filesystem::remove_all(folder), std::filesystem::create_directories(folder);
    const std::string scene = "probe_on_liver --set liver.triangles=600 --set probe.triangles=300";
    ASSERT_EQ(run_program("run " + scene + " --seconds 0.7 --figures-only --out plain", folder, folder).code, 0);
    const Outcome made = run_program("view plain --out run.html", folder, folder);
    EXPECT_EQ(made.code, 0) << made.err;
    EXPECT_NE(made.out.find("file://"), std::string::npos) << made.out;
    EXPECT_NE(read_text_file(folder / "run.html").find("22 frames"), std::string::npos) << "at 0 s and thirty a second";
    for (const auto& entry : std::filesystem::directory_iterator(folder)) EXPECT_EQ(entry.path().string().find(".run"), std::string::npos);
    // not the run that it was
    std::string metrics = read_text_file(folder / "plain/metrics.json");
    metrics.replace(metrics.find("\"600\""), 5, "\"500\"");
    write_whole_file(folder / "plain/metrics.json", metrics);
    EXPECT_EQ(run_program("view plain --out run.html", folder, folder).code, 1);
    EXPECT_EQ(run_program("view . --out run.html", folder, folder).code, 2) << "no run";
    EXPECT_EQ(run_program("view plain --out run.png", folder, folder).code, 2);

    ASSERT_EQ(run_program("run " + scene + " --seconds 0.5 --size 320x240 --capture 5-9,worst --out kept", folder, folder).code, 0);
    const std::string capture = "kept/captures/passes_5-9.cap";
    EXPECT_EQ(run_program("view " + capture, folder, folder).code, 0);
    const std::string page = read_text_file(folder / "kept/captures/passes_5-9.html");
    EXPECT_NE(page.find("src=\"data:image/png;base64,"), std::string::npos) << "the picture in the capture";
    EXPECT_EQ(run_program("capture info " + capture + " --picture picture.png", folder, folder).code, 0);
    const Image picture = load_image(folder / "picture.png");
    EXPECT_EQ(picture.width, 320u);
    EXPECT_EQ(picture.height, 240u);
    // a red liver in the middle, something else in the corner
    const auto pixel = [&](size_t x, size_t y) { return std::span(picture.rgba).subspan(4 * (y * picture.width + x), 3); };
    EXPECT_GT(pixel(160, 140)[0], pixel(160, 140)[2] + 40);
    EXPECT_LT(std::abs(pixel(2, 2)[0] - pixel(2, 2)[2]), 40);
    for (const char* file : {"passes_5-9.cap", "worst.cap"}) {
        const nlohmann::json info =
            nlohmann::json::parse(run_program("capture info --json kept/captures/" + std::string(file), folder, folder).out);
        EXPECT_EQ(info["picture"]["pass"], info["first_pass"].get<int>() + info["passes"].get<int>() - 1) << file;
    }
    EXPECT_EQ(run_program("replay " + capture, folder, folder).code, 0);
    // a run that draws none takes no time for them
    ASSERT_EQ(run_program("run " + scene + " --seconds 0.2 --no-render --capture 5-9 --out bare", folder, folder).code, 0);
    EXPECT_EQ(run_program("capture info --json bare/captures/passes_5-9.cap", folder, folder).out.find("\"picture\":{"), std::string::npos);
}

// Non-finite places, as of a run that broke, are shown where they last were.
TEST(Player, SurvivesWhatIsNotFinite) {
    World world = quick_scene();
    const uint32_t soft = is_deformable(world.bodies, 0) ? 0 : 1, first = world.bodies.particles[soft].first;
    ThreadPool pool(1);
    pool.run([&] {
        Frame frame(std::move(world), {});
        PlayerRecorder recorder(frame, true);
        const Moment before = moment_of(frame.world());
        frame.world().particles.offset[first].x = NAN;
        frame.world().particles.offset[first + 1].y = 1e30f;
        recorder.after_pass(frame, {});
        const Decoded d = decode(recorder.coded("", {}));
        const std::vector<Vec3d> shown = places(d, d.moment.back(), soft);
        EXPECT_NEAR(shown[0].x(), before.place[soft][0].x(), d.header["bodies"][soft]["step"]);
        EXPECT_TRUE(std::isfinite(shown[1].y()));
    });
}

}  // namespace
}  // namespace trocar
