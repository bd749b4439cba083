#include "systems/app/player/player_effects.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "engine/draw/depth_colours.hpp"
#include "systems/app/player/player_code.hpp"
#include "systems/frame/state.hpp"
namespace trocar {
namespace {

// Places as steps from the one before.
class EffectPlaces {
 public:
    EffectPlaces(std::vector<uint8_t>& out, const Vec3d& origin, double step) : out_(out), origin_(origin), step_(step) {}
    void put(const Vec3d& place) {
        for (int k = 0; k < 3; ++k) {
            const double at = (place[k] - origin_[k]) / step_;
            const int64_t now = std::abs(at) < 1e9 ? std::llround(at) : 0;  // 0 also for what is no number
            put_signed(out_, now - before_[static_cast<size_t>(k)]);
            before_[static_cast<size_t>(k)] = now;
        }
    }

 private:
    std::vector<uint8_t>& out_;
    Vec3d origin_;
    double step_;
    std::array<int64_t, 3> before_{};
};

void put_effect_colour(std::vector<uint8_t>& out, const std::array<float, 3>& linear) {
    for (const float x : linear) out.push_back(srgb_byte(x));
}

// Rods of which each begins where the one before ends, as one line.
size_t rods_of_line(std::span<const PictureRod> rods) {
    size_t count = 1;
    while (count < rods.size() && rods[count].from == rods[count - 1].to && rods[count].radius == rods[0].radius &&
           rods[count].colour == rods[0].colour)
        ++count;
    return count;
}

void put_lines(std::vector<uint8_t>& out, std::span<const PictureRod> rods, EffectPlaces& places) {
    size_t lines = 0;
    for (size_t i = 0; i < rods.size(); i += rods_of_line(rods.subspan(i))) ++lines;
    put_number(out, lines);
    for (size_t i = 0; i < rods.size();) {
        const size_t count = rods_of_line(rods.subspan(i));
        put_number(out, count + 1), put_float(out, rods[i].radius), put_effect_colour(out, rods[i].colour);
        places.put(rods[i].from);
        for (const size_t end = i + count; i < end; ++i) places.put(rods[i].to);
    }
}

void put_balls(std::vector<uint8_t>& out, std::span<const PicturePoint> points, EffectPlaces& places) {
    put_number(out, points.size());
    for (const PicturePoint& p : points) places.put(p.position), put_float(out, p.radius), put_effect_colour(out, p.colour);
}

void put_smoke(std::vector<uint8_t>& out, std::span<const PicturePuff> puffs, EffectPlaces& places) {
    put_number(out, puffs.size());
    for (const PicturePuff& p : puffs) places.put(p.position), put_float(out, p.spread), put_float(out, p.extinction);
}

uint64_t in_whole_steps(float value, double step) {
    return value > 0 ? static_cast<uint64_t>(std::min(std::round(static_cast<double>(value) / step), 1e9)) : 0;
}

// One number a vertex; of zeros that follow each other one, and how many more there are.
template <typename Value>
void put_sparse(std::vector<uint8_t>& out, uint32_t count, const Value& value) {
    put_number(out, count);
    for (uint32_t v = 0; v < count;) {
        const uint64_t now = value(v++);
        put_number(out, now);
        const uint32_t first = v;
        while (now == 0 && v < count && value(v) == 0) ++v;
        if (now == 0) put_number(out, v - first);
    }
}

// Of bodies that are wet: thickness at every vertex, and where there is any the height of its surface, how level that is, and blood.
void put_films(std::vector<uint8_t>& out, const PictureSnapshot& effects) {
    put_number(out, static_cast<uint64_t>(std::ranges::count_if(effects.body, [](const PictureBody& b) { return b.liquid.count > 0; })));
    for (uint32_t b = 0; b < effects.body.size(); ++b) {
        const Range range = effects.body[b].liquid;
        if (range.count == 0) continue;
        const std::span<const Float4> liquid(effects.liquid.data() + range.first, range.count);
        const auto thickness = [&](uint32_t v) { return in_whole_steps(liquid[v].x, PlayerEffects::kFilmStep); };
        put_number(out, b), put_sparse(out, range.count, thickness);
        const auto column = [&](const auto& value) {
            for (uint32_t v = 0; v < range.count; ++v)
                if (thickness(v) > 0) out.push_back(static_cast<uint8_t>(std::min<uint64_t>(value(liquid[v]), 255)));
        };
        for (uint32_t v = 0; v < range.count; ++v)
            if (thickness(v) > 0) put_signed(out, std::llround(std::clamp(liquid[v].y / PlayerEffects::kRiseStep, -1e6, 1e6)));
        column([](const Float4& film) { return in_whole_steps(film.z, 1.0 / 255); });
        column([](const Float4& film) { return in_whole_steps(film.w, 1.0 / 255); });
    }
}

void put_burns(std::vector<uint8_t>& out, const PictureSnapshot& effects) {
    put_number(out, static_cast<uint64_t>(std::ranges::count_if(effects.body, [](const PictureBody& b) { return b.burnt.count > 0; })));
    for (uint32_t b = 0; b < effects.body.size(); ++b) {
        const Range range = effects.body[b].burnt;
        if (range.count == 0) continue;
        put_number(out, b);
        put_sparse(out, range.count, [&](uint32_t v) { return in_whole_steps(effects.burnt[range.first + v], 1.0 / 255); });
    }
}

}  // namespace

bool PlayerEffects::are_in(const World& w) {
    const auto staples = [](const ToolAction& action) { return action.kind == ActionKind::kStaple; };
    return !w.fluids.body.empty() || !w.threads.thread.empty() || !w.actions.heat_body.empty() ||
           std::ranges::any_of(w.actions.action, staples);
}

void PlayerEffects::put(std::vector<uint8_t>& out, const World& w, const Vec3d& origin, double point_step) {
    effects_.body.assign(w.bodies.mesh.size(), {});
    for (uint32_t b = 0; b < effects_.body.size(); ++b) effects_.body[b].mesh = w.bodies.mesh[b];
    write_picture_effects(picture_inputs(w, w.normals, scratch_), effects_);
    EffectPlaces places(out, origin, point_step);
    put_lines(out, effects_.rod, places), put_balls(out, effects_.point, places), put_smoke(out, effects_.puff, places);
    put_films(out, effects_), put_burns(out, effects_);
}

}  // namespace trocar
