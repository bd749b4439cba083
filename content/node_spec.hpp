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
    uint8_t to = 2;                                         // as NodeSwitch
    double time = std::numeric_limits<double>::infinity();  // s
    std::string tool;                                       // body of the tool whose buttons it listens to; empty = any
    uint32_t buttons = 0;                                   // bits
    std::string driven;                                     // body that reports `event`
    NodeEventKind event = NodeEventKind::kPressed;
};

// One [[tool.exchange]]: the body that comes into the hand in place of the one before it.
struct ToolExchangeSpec {
    uint32_t line = 0;
    std::string body;
    Vec3d tip = Vec3d::Zero();                              // m, body frame
    double tip_radius = 0;                                  // m, 0 = as before
    double time = std::numeric_limits<double>::infinity();  // s
    uint32_t buttons = 0;                                   // bits
};

// One [[node]]: a frame that bodies and other nodes lie in, and what it lets its body do.
struct NodeSpec {
    std::string name;
    uint32_t line = 0;
    std::string parent;              // a node before it; empty = the world
    Vec3d position = Vec3d::Zero();  // m, frame of the parent
    Quat orientation;
    double scale = 1;  // of meshes, places and paths in it
    bool enabled = true;
    // Of a dynamic node: in its own frame; a dial turns about the axis through its origin. Limits, rest and pivot are of
    // NodeDrive, but for the angles of a dial, which are in degrees here.
    NodeDrive drive;
    std::vector<NodeSwitchSpec> switches;
};

}  // namespace trocar
