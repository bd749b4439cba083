#pragma once
#include <array>
#include <vector>

#include "components/mesh.hpp"
namespace trocar {

struct SmoothEdgesScratch {
    struct Change {
        uint32_t pixel;
        std::array<uint8_t, 3> rgb;
    };
    std::vector<uint8_t> luma;
    std::vector<Change> changes;
};

// Softens jagged edges of a finished picture: where brightness jumps, finds how far the step reaches along the edge and
// mixes in the pixel on its other side by the share of the pixel that a straight edge would cover (after Lottes,
// "FXAA", NVIDIA 2009). Pixels at the border of the picture stay as they are. Several times cheaper than multisampling
// in software.
void smooth_edges(SmoothEdgesScratch& scratch, Image& image);

}  // namespace trocar
