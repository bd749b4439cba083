#include "engine/draw/fogged_picture.hpp"

#include <algorithm>
#include <array>
#include <cmath>
namespace trocar {
namespace {

// Means of 2 radius + 1 elements, `step` bytes apart; those beyond the ends are the end ones.
void blur_line(uint8_t* line, uint32_t count, size_t step, uint32_t radius, std::vector<uint8_t>& copy) {
    copy.resize(count);
    for (uint32_t channel = 0; channel < 3; ++channel) {
        for (uint32_t i = 0; i < count; ++i) copy[i] = line[i * step + channel];
        const auto at = [&](int64_t i) { return uint32_t{copy[static_cast<size_t>(std::clamp<int64_t>(i, 0, count - 1))]}; };
        const uint32_t width = 2 * radius + 1;
        uint32_t sum = 0;
        for (int64_t i = -int64_t{radius}; i <= int64_t{radius}; ++i) sum += at(i);
        for (uint32_t i = 0; i < count; ++i) {
            line[i * step + channel] = static_cast<uint8_t>((sum + width / 2) / width);
            sum += at(int64_t{i} + radius + 1);
            sum -= at(int64_t{i} - radius);
        }
    }
}

// Half of the pixels' width of a row within the round picture, of its centre; as the mask of gl_shaders.hpp has it.
uint32_t half_row(const Image& image, uint32_t y) {
    const double radius = 0.535 * std::min(image.width, image.height), dy = y + 0.5 - 0.5 * image.height;
    return dy * dy < radius * radius ? static_cast<uint32_t>(std::sqrt(radius * radius - dy * dy)) : 0;
}

template <typename Visit>
void each_pixel_inside(const Image& image, const Visit& visit) {
    for (uint32_t y = 0; y < image.height; ++y) {
        const uint32_t half = std::min(half_row(image, y), image.width / 2);
        for (uint32_t x = image.width / 2 - half; x < image.width / 2 + half; ++x) visit(size_t{4} * (size_t{y} * image.width + x));
    }
}

}  // namespace

void fog_picture(double fog, FogScratch& scratch, Image& image) {
    const auto part = static_cast<uint32_t>(std::lround(256 * std::clamp(fog, 0.0, 1.0)));
    if (part == 0 || image.rgba.empty()) return;
    scratch.blurred = image.rgba;
    const auto radius = static_cast<uint32_t>(std::lround(fog * image.height / 36));
    for (int pass = 0; pass < 3 && radius > 0; ++pass) {  // three boxes are nearly a Gaussian
        for (uint32_t y = 0; y < image.height; ++y)
            blur_line(&scratch.blurred[size_t{4} * y * image.width], image.width, 4, radius, scratch.row);
        for (uint32_t x = 0; x < image.width; ++x)
            blur_line(&scratch.blurred[size_t{4} * x], image.height, size_t{4} * image.width, radius, scratch.row);
    }
    std::array<uint64_t, 3> sum{};
    uint64_t pixels = 0;
    each_pixel_inside(image, [&](size_t i) {
        for (size_t c = 0; c < 3; ++c) sum[c] += image.rgba[i + c];
        ++pixels;
    });
    if (pixels == 0) return;
    // half of the scattered light is the veil, whiter than what is behind it
    std::array<uint32_t, 3> veil;
    for (size_t c = 0; c < 3; ++c) veil[c] = static_cast<uint32_t>((sum[c] / pixels + 190) / 2);
    each_pixel_inside(image, [&](size_t i) {
        for (size_t c = 0; c < 3; ++c) {
            const uint32_t scattered = (uint32_t{scratch.blurred[i + c]} + veil[c]) / 2;
            image.rgba[i + c] = static_cast<uint8_t>((image.rgba[i + c] * (256 - part) + scattered * part + 128) / 256);
        }
    });
}

}  // namespace trocar
