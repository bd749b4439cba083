#pragma once
#include <string_view>

#include "components/mesh.hpp"
namespace trocar {

struct OverlayColour {
    uint8_t red = 255, green = 255, blue = 255, opacity = 255;  // sRGB
};

// Writes one line of text into a picture with a built-in 5 x 7 font: 6 * scale pixels per character, 7 *
// scale high, plus 2 * scale below the line for g, j, p, q and y; x, y is the upper left corner. Clipped to
// the picture; a character missing in the font appears as '?'.
void draw_text(Image& image, int32_t x, int32_t y, uint32_t scale, const OverlayColour& colour, std::string_view text);
inline uint32_t text_width(std::string_view text, uint32_t scale) {
    return text.empty() ? 0 : (6 * static_cast<uint32_t>(text.size()) - 1) * scale;
}

// Blends a rectangle with rounded corners (radius in pixels) over a picture.
void draw_panel(Image& image, int32_t x, int32_t y, uint32_t width, uint32_t height, uint32_t corner, const OverlayColour& colour);

}  // namespace trocar
