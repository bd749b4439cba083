#pragma once
#include <limits>
#include <string>

#include "components/links.hpp"
namespace trocar {

// One [[body.group]]: part of a body at rest, by name. A region of the body frame, or all of one material of the mesh file.
struct GroupSpec {
    std::string name;
    uint32_t line = 0;
    Region region;
    std::string material;  // empty = any
};

// One [[body.region]]: where a body differs from its tissue.
struct TissueRegionSpec {
    uint32_t line = 0;
    std::string group;  // or
    Region region;      // body frame at rest, or
    std::string field;  // a PLY file in the body frame, m, whose vertices carry `property`: the factor of stiffness
    std::string property = "stiffness";
    double stiffness = 1;  // factor of Young's modulus
    double density = 1;    // factor
    bool fixed = false;
};

// One [[link]] or [[staple]]: nodes of a deformable body that another body holds for a time.
struct LinkSpec {
    std::string name;
    uint32_t line = 0;
    std::string body, holder;
    std::string group;  // of body; else region and frame
    Region region;
    RegionFrame frame = RegionFrame::kHolder;
    bool frame_given = false;                                 // else the holder's if it is rigid, and the world's
    double within = std::numeric_limits<double>::infinity();  // m
    uint32_t most = kNone;
    double stiffness = 0;  // N/m, of each link; 0 = four times that of the body's springs
    double rest = -1;      // m
    double break_strain = std::numeric_limits<double>::infinity();
    double from = 0;  // s
    double until = std::numeric_limits<double>::infinity();
    bool grip = false;  // as long as the first button of the holder's tool is down
};

// One [[cut]]: triangles that are taken away from a body at a time.
struct CutSpec {
    std::string name;
    uint32_t line = 0;
    std::string body;
    std::string group;  // of body; else region, body frame at rest
    Region region;
    double time = 0;  // s
};

}  // namespace trocar
