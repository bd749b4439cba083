#include "systems/app/capture/capture_difference.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <functional>

#include "engine/base/error.hpp"
#include "systems/app/console/format.hpp"
#include "systems/app/report/run_costs.hpp"
namespace trocar {
namespace {

const CaptureArray* array_named(const CaptureRecord& record, const std::string& name) {
    const auto found = std::find_if(record.arrays.begin(), record.arrays.end(), [&](const CaptureArray& a) { return a.name == name; });
    return found == record.arrays.end() ? nullptr : &*found;
}

template <typename T>
T element(const CaptureArray& a, size_t at) {
    T value;
    std::memcpy(&value, a.bytes.data() + at * sizeof(T), sizeof(T));
    return value;
}

uint64_t whole_number(const CaptureArray& a, size_t at) {
    switch (a.type) {
        case ArrayType::kU8:
            return element<uint8_t>(a, at);
        case ArrayType::kU16:
            return element<uint16_t>(a, at);
        case ArrayType::kU32:
            return element<uint32_t>(a, at);
        default:
            return element<uint64_t>(a, at);
    }
}

// "0.25 and 0.5, 0.25 apart"
std::string values_text(const CaptureArray& a, const CaptureArray& b, size_t at) {
    if (a.type == ArrayType::kF32 || a.type == ArrayType::kF64) {
        const bool single = a.type == ArrayType::kF32;
        const auto value = [&](const CaptureArray& from) {
            return single ? static_cast<double>(element<float>(from, at)) : element<double>(from, at);
        };
        const int digits = single ? 9 : 17;
        return format("%.*g and %.*g, %.6g apart", digits, value(a), digits, value(b), std::abs(value(a) - value(b)));
    }
    const uint64_t x = whole_number(a, at), y = whole_number(b, at);
    return format("%llu and %llu, %llu apart", static_cast<unsigned long long>(x), static_cast<unsigned long long>(y),
                  static_cast<unsigned long long>(std::max(x, y) - std::min(x, y)));
}

// Names and particle ranges of a scene's bodies; empty if the record holds something else.
Bodies bodies_of(const CaptureRecord& scene) {
    try {
        World world;
        load_resource(scene, Resource::kBodies, world);
        return std::move(world.bodies);
    } catch (const InputError&) {
        return {};
    }
}

std::string name_text(const Bodies& bodies, uint64_t body) { return body < bodies.name.size() ? "\"" + bodies.name[body] + "\"" : "none"; }

// " (body "liver", particle 17)": the owner of an array element; empty if it is unknown.
std::string owner_text(const CaptureRecord& record, const CaptureArray& array, size_t row, const Bodies& bodies) {
    const std::string group = array.name.substr(0, array.name.find('.') + 1);
    if (group == "particles.") {
        for (size_t b = 0; b < bodies.particles.size() && b < bodies.name.size(); ++b) {
            const Range& range = bodies.particles[b];
            if (row >= range.first && row - range.first < range.count)
                return " (body " + name_text(bodies, b) + ", particle " + std::to_string(row - range.first) + ")";
        }
        return "";
    }
    if (group == "poses.") return " (body " + name_text(bodies, row) + ")";
    const auto of = [&](const char* field) -> const CaptureArray* {
        const CaptureArray* a = array_named(record, group + field);
        return a && a->type == ArrayType::kU32 && a->columns == 1 && row < a->rows ? a : nullptr;
    };
    if (const CaptureArray* body = of("body")) return " (body " + name_text(bodies, whole_number(*body, row)) + ")";
    const CaptureArray *a = of("a"), *b = of("b");
    if (!a || !b) return "";
    return " (bodies " + name_text(bodies, whole_number(*a, row)) + " and " + name_text(bodies, whole_number(*b, row)) + ")";
}

// Replays a pass and passes the result to `look`; false if the result differs from the recording.
bool run_again(const Capture& capture, uint64_t pass, const std::function<void(const Frame&, const CaptureStep&)>& look) {
    const std::optional<size_t> s = stretch_of(capture, pass);
    if (!s) return false;
    Frame frame(world_at(capture, *s), replay_options(capture, nullptr));
    take_up(capture, *s, frame);
    for (const CaptureStep& step : capture.stretches[*s].steps) {
        take_input(step, frame);
        frame.step();
        if (state_hash(frame.world()) != step.state_hash) return false;
        if (step.pass < pass) continue;
        look(frame, step);
        return true;
    }
    return false;
}

}  // namespace

std::string first_difference(const CaptureRecord& a, const CaptureRecord& b, const CaptureRecord* scene) {
    for (const CaptureArray& x : a.arrays) {
        const CaptureArray* y = array_named(b, x.name);
        if (!y || x.type != y->type || x.columns != y->columns) return x.name + " is missing";
        if (x.bytes == y->bytes && x.rows == y->rows) continue;
        if (x.rows != y->rows) return x.name + ": " + std::to_string(x.rows) + " rows and " + std::to_string(y->rows);
        const auto differs = std::mismatch(x.bytes.begin(), x.bytes.end(), y->bytes.begin()).first;
        const size_t at = static_cast<size_t>(differs - x.bytes.begin()) / element_size(x.type), row = at / x.columns;
        std::string text = x.name + (x.type == ArrayType::kU8 ? ", byte " : ", row ") + std::to_string(row);
        if (x.columns > 1) text += ", column " + std::to_string(at % x.columns);
        if (scene) text += owner_text(a, x, row, bodies_of(*scene));
        return text + ": " + values_text(x, *y, at);
    }
    return "";
}

std::string pass_difference(const Capture& a, const Capture& b, uint64_t pass) {
    const std::optional<size_t> in_b = stretch_of(b, pass);
    if (!in_b) return "";
    const CaptureStep& other = b.stretches[*in_b].steps[pass - b.stretches[*in_b].pass];
    CaptureRecord one, two;
    std::string stage;
    const auto keep = [](const Frame& frame, CaptureRecord& record) { save_resources(frame.world(), ResourceKind::kState, record); };
    const bool same_here = run_again(a, pass,
                                     [&](const Frame& frame, const CaptureStep&) {
                                         keep(frame, one);
                                         stage = first_stage(frame, other);
                                     }) &&
                           run_again(b, pass, [&](const Frame& frame, const CaptureStep&) { keep(frame, two); });
    if (!same_here) return "";
    const std::string array = first_difference(one, two, &a.scene);
    return (stage.empty() ? "" : "first in stage " + stage) + (stage.empty() || array.empty() ? "" : "; ") +
           (array.empty() ? "" : "the state after it first in " + array);
}

std::optional<PairFigures> dearest_pair(const Capture& capture, const CaptureStep& recorded) {
    std::optional<PairFigures> dearest;
    const auto look = [&](const Frame& frame, const CaptureStep& step) {
        const World& w = frame.world();
        for (const PairCost& c : pair_costs(w)) {
            const double ms = c.share * step.detection_ms;
            if (dearest && ms <= dearest->ms) continue;
            dearest = PairFigures{
                w.bodies.name[c.a] + "/" + w.bodies.name[c.b], 1, ms, ms, static_cast<double>(c.vertices), w.occupancy.cell_size, 0};
        }
    };
    try {
        if (!run_again(capture, recorded.pass, look)) return {};
    } catch (const InputError&) {
        return {};  // a scene that cannot be simulated can still be compared
    }
    return dearest;
}

}  // namespace trocar
