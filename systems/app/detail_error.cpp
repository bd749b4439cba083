#include "systems/app/detail_error.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <nlohmann/json.hpp>

#include "content/build_scene.hpp"
#include "engine/error.hpp"
#include "systems/frame.hpp"
namespace trocar {
namespace {

// Sum and largest of squares.
struct Squares {
    double sum = 0, largest = 0, count = 0;
    void add(double square) { sum += square, largest = std::max(largest, square), ++count; }
    double rms() const { return count > 0 ? std::sqrt(sum / count) : 0; }
    double most() const { return std::sqrt(largest); }
};

struct ToolError {
    Squares hand, hand_full, tissue, tissue_full;  // N^2
};

// s of the stage that levels of detail are for.
double advance_seconds(const Frame& frame) {
    const uint32_t row = frame.row_of(StageId::kAdvance);
    return row == kNone ? 0 : static_cast<double>(frame.times().stage_ns[row]) * 1e-9;
}

void compare_places(const World& full, const World& coarse, uint32_t body, Squares& error) {
    const uint32_t first = full.bodies.particles[body].first, vertices = full.meshes.info[full.bodies.mesh[body]].vertices.count;
    const Vec3d shift = coarse.poses.origin[body] - full.poses.origin[body];
    for (uint32_t p = first; p < first + vertices; ++p) {
        const Float4 &a = full.particles.offset[p], &b = coarse.particles.offset[p];
        error.add((shift + Vec3d(double{b.x} - a.x, double{b.y} - a.y, double{b.z} - a.z)).squaredNorm());
    }
}

void compare_tools(const World& full, const World& coarse, std::vector<ToolError>& tools) {
    const double period = full.clock.period * 1e-3;
    for (size_t t = 0; t < tools.size(); ++t) {
        const ToolState &a = full.haptics.state[t], &b = coarse.haptics.state[t];
        tools[t].hand.add((b.output.force - a.output.force).squaredNorm());
        tools[t].hand_full.add(a.output.force.squaredNorm());
        tools[t].tissue.add((b.contact_impulse - a.contact_impulse).squaredNorm() / (period * period));
        tools[t].tissue_full.add(a.contact_impulse.squaredNorm() / (period * period));
    }
}

// Processor time of the program so far, s: tells more than a clock on the wall where others use the machine too.
double processor_seconds() {
    timespec t{};
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

// What passes cost, s.
struct Cost {
    double advance = 0, processor = 0;
    void step(Frame& frame) {
        const double before = processor_seconds();
        frame.step();
        processor += processor_seconds() - before;
        advance += advance_seconds(frame);
    }
};

// One way and the other, and what is between them.
struct Comparison {
    double passes = 0;
    Cost full, coarse;
    std::vector<double> far;     // passes, per rule
    std::vector<Squares> place;  // m^2, per rule
    std::vector<ToolError> tool;
};

std::string text_of(const World& w, const Comparison& c) {
    std::string text;
    char line[320];
    for (size_t r = 0; r < c.place.size(); ++r) {
        const uint32_t body = w.detail.body[r];
        std::snprintf(line, sizeof line,
                      "%s: coarse in %.1f %% of the passes; places differ from the full model's by %.3g mm rms, %.3g mm at most (%.2g %% "
                      "of its size)\n",
                      w.bodies.name[body].c_str(), 100 * c.far[r] / c.passes, 1e3 * c.place[r].rms(), 1e3 * c.place[r].most(),
                      100 * c.place[r].most() / (2 * w.meshes.info[w.bodies.mesh[body]].radius));
        text += line;
    }
    for (size_t t = 0; t < c.tool.size(); ++t) {
        const ToolError& tool = c.tool[t];
        std::snprintf(
            line, sizeof line,
            "%s: force on the hand differs by %.3g N rms, %.3g N at most (of %.3g N rms), that of the tissue by %.3g N rms (of %.3g N)\n",
            w.bodies.name[w.haptics.tool[t].body].c_str(), tool.hand.rms(), tool.hand.most(), tool.hand_full.rms(), tool.tissue.rms(),
            tool.tissue_full.rms());
        text += line;
    }
    std::snprintf(line, sizeof line,
                  "advance: %.3f s, of the full model %.3f s (%.2f of it); passes in all: %.3f s of processor time, %.3f s (%.2f)\n",
                  c.coarse.advance, c.full.advance, c.coarse.advance / c.full.advance, c.coarse.processor, c.full.processor,
                  c.coarse.processor / c.full.processor);
    return text + line;
}

std::string json_of(const World& w, const Comparison& c, double seconds) {
    nlohmann::json out = {{"seconds", seconds},
                          {"passes", c.passes},
                          {"advance_full_s", c.full.advance},
                          {"advance_s", c.coarse.advance},
                          {"processor_full_s", c.full.processor},
                          {"processor_s", c.coarse.processor},
                          {"bodies", nlohmann::json::array()},
                          {"tools", nlohmann::json::array()}};
    for (size_t r = 0; r < c.place.size(); ++r)
        out["bodies"].push_back({{"body", w.bodies.name[w.detail.body[r]]},
                                 {"coarse_share", c.far[r] / c.passes},
                                 {"place_rms_m", c.place[r].rms()},
                                 {"place_largest_m", c.place[r].most()}});
    for (size_t t = 0; t < c.tool.size(); ++t) {
        const ToolError& tool = c.tool[t];
        out["tools"].push_back({{"body", w.bodies.name[w.haptics.tool[t].body]},
                                {"hand_error_rms_n", tool.hand.rms()},
                                {"hand_error_largest_n", tool.hand.most()},
                                {"hand_rms_n", tool.hand_full.rms()},
                                {"tissue_error_rms_n", tool.tissue.rms()},
                                {"tissue_rms_n", tool.tissue_full.rms()}});
    }
    return out.dump(2) + "\n";
}

}  // namespace

std::string detail_error(const SceneFile& file, double seconds, bool json) {
    World whole = std::move(build_scene(file, Looks::kPlain).world);
    if (whole.detail.body.empty()) throw InputError(file.path.string() + ": no body of this scene has a [body.lod]");
    whole.detail = {};
    Frame full(std::move(whole), {}), coarse(std::move(build_scene(file, Looks::kPlain).world), {});
    const World &a = full.world(), &b = coarse.world();
    const DetailRules& rules = b.detail;
    Comparison c;
    c.far.resize(rules.body.size());
    c.place.resize(rules.body.size());
    c.tool.resize(a.haptics.tool.size());
    do {
        c.full.step(full), c.coarse.step(coarse), ++c.passes;
        for (size_t r = 0; r < rules.body.size(); ++r) {
            c.far[r] += stepping_of(b.bodies, rules.body[r]).integrator == Integrator::kMidpoint;
            compare_places(a, b, rules.body[r], c.place[r]);
        }
        compare_tools(a, b, c.tool);
    } while (static_cast<double>(a.clock.tick) < seconds * 1000);
    return json ? json_of(b, c, seconds) : text_of(b, c);
}

}  // namespace trocar
