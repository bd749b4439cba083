#pragma once
#include <functional>

#include "bench/rows.hpp"
#include "engine/world.hpp"
namespace trocar::bench {

// The bodies of a world in Bullet's: soft bodies of the same surface, mass and place where ours are deformable, boxes where
// they are static. Links along the edges, pose matching where ours has anchors, vertex-face contact. Empty without Bullet.
struct BulletWorld {
    std::function<void()> step;      // 1/60 s
    std::function<double()> lowest;  // m, of all nodes
    explicit operator bool() const { return static_cast<bool>(step); }
};
BulletWorld bullet_world(const World& world);

}  // namespace trocar::bench
