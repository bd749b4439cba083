#pragma once
#include <functional>

#include "bench/table.hpp"
#include "engine/world/world.hpp"
namespace trocar::bench {

// A world's bodies in Bullet: soft bodies of the same surface, mass and position for deformable ones, boxes
// for static ones. Links along edges, pose matching for anchors, vertex-face contact. Empty without Bullet.
struct BulletWorld {
    std::function<void()> step;      // 1/60 s
    std::function<double()> lowest;  // m, of all nodes
    explicit operator bool() const { return static_cast<bool>(step); }
};
BulletWorld bullet_world(const World& world);

}  // namespace trocar::bench
