#include <algorithm>

#include "engine/surfaces.hpp"
#include "systems/advance_parts.hpp"
namespace trocar {
namespace {

// Fewer rows than this are done before other threads have heard of them.
constexpr uint32_t kFewestRows = 2048;
// A strip must be wider than bodies are, so that most bodies touch their own strip and the next alone.
constexpr uint32_t kBodiesPerStrip = 96, kMostStrips = 32;

bool may_split(const AdvanceScratch& s) {
    const auto is_led = [&](const AdvanceRigid& rigid) {
        return rigid.node != kNone && (rigid.free == kNone || s.free[rigid.free].held || s.free[rigid.free].drive != kNone);
    };
    const auto rides = [](const AdvanceBody& b) { return b.skin_node != nullptr; };
    return s.dealt.size() >= kFewestRows && s.body.size() + s.free.size() >= 2 * kBodiesPerStrip &&
           std::none_of(s.body.begin(), s.body.end(), rides) && std::none_of(s.rigid.begin(), s.rigid.end(), is_led);
}

// Puts bodies into strips of equal numbers along the axis on which they spread most. Returns the number of strips.
uint32_t find_strips(AdvanceScratch& s) {
    const uint32_t soft = static_cast<uint32_t>(s.body.size()), bodies = soft + static_cast<uint32_t>(s.free.size());
    const auto place = [&](uint32_t i) -> Vec4d {
        if (i >= soft) return s.node.place[s.rigid[s.free[i - soft].rigid].node];
        return s.body[i].origin + float_vec4(_mm_load_ps(&s.body[i].now->x));
    };
    Vec4d sum = {}, squares = {};
    for (uint32_t i = 0; i < bodies; ++i) {
        const Vec4d p = place(i);
        sum += p, squares += p * p;
    }
    const Vec4d spread = squares - sum * sum / static_cast<double>(bodies);
    const uint32_t axis = spread[0] >= spread[1] && spread[0] >= spread[2] ? 0 : spread[1] >= spread[2] ? 1 : 2;
    s.along.clear();
    for (uint32_t i = 0; i < bodies; ++i) {
        const double x = place(i)[axis];
        s.along.push_back({std::isfinite(x) ? x : 0.0, i});
    }
    std::sort(s.along.begin(), s.along.end());
    const uint32_t strips = std::min(bodies / kBodiesPerStrip, kMostStrips);
    s.strip.resize(bodies);
    for (uint32_t i = 0; i < bodies; ++i) s.strip[s.along[i].second] = static_cast<uint32_t>(uint64_t{i} * strips / bodies);
    return strips;
}

void set_groups(AdvanceScratch& s, const std::array<uint32_t, 5>& phase) {
    s.phase = phase;
    if (s.group.size() < phase[4]) s.group.resize(phase[4]);
    const uint32_t strips = phase[1];
    for (uint32_t g = 0; g < phase[1]; ++g) s.group[g].strips = {g, 1};
    for (uint32_t g = phase[1]; g < phase[2]; ++g) s.group[g].strips = {2 * (g - phase[1]), 2};
    for (uint32_t g = phase[2]; g < phase[3]; ++g) s.group[g].strips = {2 * (g - phase[2]) + 1, 2};
    for (uint32_t g = phase[3]; g < phase[4]; ++g) s.group[g].strips = {0, strips};
}

}  // namespace

void group_rows(AdvanceIsland& island) {
    AdvanceScratch& s = island.scratch;
    if (!may_split(s)) {
        set_groups(s, {0, 1, 1, 1, 1});
        s.group[0].plan = {0, static_cast<uint32_t>(s.dealt.size())};
        return;
    }
    const uint32_t strips = find_strips(s), even = strips / 2, odd = (strips - 1) / 2;  // borders
    set_groups(s, {0, strips, strips + even, strips + even + odd, strips + even + odd + 1});
    const auto strip_of = [&](uint32_t body) {
        const uint32_t slot = s.slot_of_body[body];
        if (is_deformable(island.inputs.bodies, body)) return s.strip[slot];
        return s.rigid[slot].free == kNone ? kNone : s.strip[s.body.size() + s.rigid[slot].free];
    };
    const auto group_of = [&](uint32_t row) {
        uint32_t a = strip_of(island.rows.body[row]), b = strip_of(island.rows.other[row]);
        if (a == kNone) a = b;
        if (b == kNone) b = a;
        if (a == b) return a;
        const uint32_t low = std::min(a, b);
        if (std::max(a, b) > low + 1) return s.phase[3];
        return s.phase[low % 2 ? 2 : 1] + low / 2;
    };
    // a counting sort: rows keep their order within a group
    const uint32_t rows = static_cast<uint32_t>(s.dealt.size());
    s.group_of_row.resize(rows);
    for (uint32_t g = 0; g < s.phase[4]; ++g) s.group[g].plan = {};
    for (uint32_t i = 0; i < rows; ++i) ++s.group[s.group_of_row[i] = group_of(s.dealt[i])].plan.count;
    s.next_of_group.assign(s.phase[4], 0);
    uint32_t first = 0;
    for (uint32_t g = 0; g < s.phase[4]; ++g) {
        s.next_of_group[g] = s.group[g].plan.first = first;
        first += s.group[g].plan.count;
    }
    s.ungrouped.swap(s.dealt);
    s.dealt.resize(rows);
    for (uint32_t i = 0; i < rows; ++i) s.dealt[s.next_of_group[s.group_of_row[i]]++] = s.ungrouped[i];
}

}  // namespace trocar
