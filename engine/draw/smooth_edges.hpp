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

// Antialiases a finished picture: at a jump of brightness, finds how far the step extends along the edge and
// blends with the pixel on its other side by the area of the pixel that a straight edge would cover (after
// Lottes, "FXAA", NVIDIA 2009). Pixels at the border of the picture are unchanged. Several times cheaper than
// multisampling in software.
void smooth_edges(SmoothEdgesScratch& scratch, Image& image);

}  // namespace trocar
