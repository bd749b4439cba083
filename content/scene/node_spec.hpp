#pragma once
#include <limits>
#include <string>
#include <vector>

#include "components/math.hpp"
#include "components/nodes.hpp"
namespace trocar {

// One [[node.switch]].
struct NodeSwitchSpec {
    uint32_t line = 0;
    std::string tool;    // whose buttons trigger it; empty = any tool
    std::string driven;  // body whose `event` triggers it
    NodeSwitch toggle;
};

// One [[tool.exchange]]: the body that replaces the tool's previous one.
struct ToolExchangeSpec {
    uint32_t line = 0;
    std::string body;
    Vec3d tip = Vec3d::Zero();                              // m, body frame
    double tip_radius = 0;                                  // m, 0 = unchanged
    double time = std::numeric_limits<double>::infinity();  // s
    uint32_t buttons = 0;                                   // bits
};

// One [[node]]: a frame for bodies and other nodes, and the degree of freedom of its body.
struct NodeSpec {
    std::string name;
    uint32_t line = 0;
    std::string parent;              // an earlier node; empty = the world
    Vec3d position = Vec3d::Zero();  // m, frame of the parent
    Quat orientation;
    double scale = 1;  // applies to meshes, positions and paths in the node
    bool enabled = true;
    // For a dynamic node: in its own frame; a dial turns about the axis through its origin. Limits, rest and
    // pivot as in NodeDrive, except that the angles of a dial are in degrees.
    NodeDrive drive;
    std::vector<NodeSwitchSpec> switches;
};

}  // namespace trocar
