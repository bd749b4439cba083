#include "engine/draw/smooth_edges.hpp"

#include <immintrin.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdlib>

namespace trocar {
namespace {

constexpr int32_t kBlock = 16;           // pixels processed together
constexpr int32_t kReach = 16;           // pixels searched along an edge to either side
constexpr float kCornerStrength = 0.5f;  // larger blurs shallow edges, smaller leaves steep ones jagged
constexpr float kLeastShare = 0.05f;     // a straight horizontal or vertical edge stays sharp
constexpr int32_t kLeastJump = 14;       // of 255: smaller differences are no edge

struct Step {
    int32_t across = 0;  // index step to the pixel on the other side
    int32_t along = 0;
    int32_t jump = 0;  // luma there minus luma here
};

// Direction of the edge at a pixel, by second differences over its 3 x 3 neighbourhood.
Step find_step(const uint8_t* here, int32_t width) {
    const auto at = [here](int32_t offset) { return static_cast<int32_t>(here[offset]); };
    const int32_t n = at(-width), s = at(width), w = at(-1), e = at(1), m = at(0);
    const int32_t nw = at(-width - 1), ne = at(-width + 1), sw = at(width - 1), se = at(width + 1);
    const int32_t level = std::abs(nw - 2 * w + sw) + 2 * std::abs(n - 2 * m + s) + std::abs(ne - 2 * e + se);
    const int32_t upright = std::abs(nw - 2 * n + ne) + 2 * std::abs(w - 2 * m + e) + std::abs(sw - 2 * s + se);
    Step step;
    const bool runs_level = level >= upright;
    step.along = runs_level ? 1 : width;
    const int32_t before = runs_level ? n : w, after = runs_level ? s : e;
    const bool back = std::abs(before - m) >= std::abs(after - m);
    step.across = (back ? -1 : 1) * (runs_level ? width : 1);
    step.jump = (back ? before : after) - m;
    return step;
}

// Weight of the neighbour across the edge: 0 to 0.5.
float edge_share(const uint8_t* here, const Step& step, int32_t room_back, int32_t room_ahead) {
    const auto doubled = [&](int32_t i) {
        const uint8_t* p = here + i * step.along;
        return static_cast<int32_t>(p[0]) + static_cast<int32_t>(p[step.across]);
    };
    const int32_t middle = doubled(0), tolerance = std::max(std::abs(step.jump) / 2, 1);
    const auto walk = [&](int32_t direction, int32_t room, int32_t& change) {
        int32_t i = 1;
        for (; i <= room; ++i) {
            change = doubled(direction * i) - middle;
            if (std::abs(change) >= tolerance) break;
        }
        return std::min(i, room + 1);
    };
    int32_t change_back = 0, change_ahead = 0;
    const int32_t back = walk(-1, std::min(room_back, kReach), change_back);
    const int32_t ahead = walk(1, std::min(room_ahead, kReach), change_ahead);
    // the nearer end decides: if the edge bends to this pixel's side there, the far colour extends into it
    const int32_t change = back < ahead ? change_back : change_ahead;
    if (std::abs(change) < tolerance || (change > 0) != (step.jump > 0)) return 0;
    return 0.5f - static_cast<float>(std::min(back, ahead)) / static_cast<float>(back + ahead);
}

// Weight of the neighbour for steep edges, whose steps are too short to follow: from the 3 x 3 average.
float corner_share(const uint8_t* here, int32_t width, int32_t range) {
    const int32_t cross = here[-1] + here[1] + here[-width] + here[width];
    const int32_t corners = here[-width - 1] + here[-width + 1] + here[width - 1] + here[width + 1];
    const float average = static_cast<float>(2 * cross + corners) / 12.0f;
    const float off = std::min(std::abs(average - static_cast<float>(here[0])) / static_cast<float>(range), 1.0f);
    const float eased = off * off * (3 - 2 * off);
    return kCornerStrength * eased * eased;
}

// Sized for whole blocks.
void find_luma(const Image& image, std::vector<uint8_t>& luma) {
    const size_t count = size_t{image.width} * image.height;
    luma.resize(count + 2 * kBlock);
    const uint8_t* rgba = image.rgba.data();
    for (size_t i = 0; i < count; ++i) luma[i] = static_cast<uint8_t>((5 * rgba[4 * i] + 9 * rgba[4 * i + 1] + 2 * rgba[4 * i + 2]) / 16);
}

// One bit per pixel of the sixteen from `here` whose cross-shaped neighbourhood spans kLeastJump or more.
uint32_t find_jumps(const uint8_t* here, int32_t width) {
    const auto load = [here](int32_t offset) { return _mm_loadu_si128(reinterpret_cast<const __m128i*>(here + offset)); };
    const __m128i m = load(0), w = load(-1), e = load(1), n = load(-width), s = load(width);
    const __m128i high = _mm_max_epu8(m, _mm_max_epu8(_mm_max_epu8(w, e), _mm_max_epu8(n, s)));
    const __m128i low = _mm_min_epu8(m, _mm_min_epu8(_mm_min_epu8(w, e), _mm_min_epu8(n, s)));
    const __m128i least = _mm_set1_epi8(kLeastJump);
    const __m128i jumps = _mm_cmpeq_epi8(_mm_max_epu8(_mm_sub_epi8(high, low), least), _mm_sub_epi8(high, low));
    return static_cast<uint32_t>(_mm_movemask_epi8(jumps));
}

void smooth_pixel(SmoothEdgesScratch& scratch, const Image& image, int32_t x, int32_t y) {
    const int32_t width = static_cast<int32_t>(image.width), height = static_cast<int32_t>(image.height);
    const int32_t pixel = y * width + x;
    const uint8_t* here = scratch.luma.data() + pixel;
    const auto [low, high] = std::minmax({here[0], here[-1], here[1], here[-width], here[width]});
    if (8 * (high - low) < high) return;
    const Step step = find_step(here, width);
    const bool level = step.along == 1;
    float share = edge_share(here, step, level ? x : y, level ? width - 1 - x : height - 1 - y);
    share = std::max(share, corner_share(here, width, high - low));
    if (!(share > kLeastShare)) return;
    const uint8_t* from = &image.rgba[4 * static_cast<size_t>(pixel)];
    const uint8_t* other = from + 4 * static_cast<ptrdiff_t>(step.across);
    SmoothEdgesScratch::Change change{static_cast<uint32_t>(pixel), {}};
    for (uint32_t c = 0; c < 3; ++c) {
        const float mixed = static_cast<float>(from[c]) * (1 - share) + static_cast<float>(other[c]) * share;
        change.rgb[c] = static_cast<uint8_t>(mixed + 0.5f);
    }
    scratch.changes.push_back(change);
}

}  // namespace

void smooth_edges(SmoothEdgesScratch& scratch, Image& image) {
    const int32_t width = static_cast<int32_t>(image.width), height = static_cast<int32_t>(image.height);
    scratch.changes.clear();
    if (width < 3 || height < 3) return;
    find_luma(image, scratch.luma);
    for (int32_t y = 1; y + 1 < height; ++y)
        for (int32_t x = 1; x + 1 < width; x += kBlock) {
            uint32_t jumps = find_jumps(scratch.luma.data() + y * width + x, width);
            for (; jumps; jumps &= jumps - 1) {
                const int32_t column = x + std::countr_zero(jumps);
                if (column + 1 < width) smooth_pixel(scratch, image, column, y);
            }
        }
    for (const auto& change : scratch.changes) std::copy(change.rgb.begin(), change.rgb.end(), &image.rgba[4 * size_t{change.pixel}]);
}

}  // namespace trocar
