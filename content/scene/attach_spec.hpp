#pragma once
#include <limits>
#include <string>

#include "components/links.hpp"
namespace trocar {

// One [[body.group]]: a named part of a body at rest, by region (body frame) or material of the mesh file.
struct GroupSpec {
    std::string name;
    uint32_t line = 0;
    Region region;
    std::string material;  // empty = any
};

// One [[body.region]]: a part of a body with tissue values of its own.
struct TissueRegionSpec {
    uint32_t line = 0;
    std::string group;  // either this,
    Region region;      // body frame at rest, this,
    std::string field;  // or this: a PLY file (body frame, m) with the stiffness factor `property`
    std::string property = "stiffness";
    double stiffness = 1;  // factor of Young's modulus
    double density = 1;    // factor
    bool fixed = false;
};

// One [[link]] or [[staple]]: particles of a deformable body that another body holds.
struct LinkSpec {
    uint32_t line = 0;
    std::string body, holder;
    std::string group;         // group of `body`; empty = use link.region and link.frame
    bool frame_given = false;  // false: holder's frame if rigid, else world
    bool grip = false;         // active while the first button of the holder's tool is pressed
    LinkGroup link;            // link.stiffness 0 = four times the stiffness of the body's springs
};

// One [[cut]]: triangles that are removed from a body at a given time.
struct CutSpec {
    std::string name;
    uint32_t line = 0;
    std::string body;
    std::string group;  // group of `body`; empty = use region, body frame at rest
    Region region;
    double time = 0;  // s
};

}  // namespace trocar
