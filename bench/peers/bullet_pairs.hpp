#pragma once
#include <memory>
#include <vector>

#include "components/math.hpp"
namespace trocar::bench {

// Bullet's dynamic tree of enlarged boxes (btDbvtBroadphase) over moving boxes.
class BulletPairs {
 public:
    explicit BulletPairs(const std::vector<Box>& boxes);
    ~BulletPairs();
    // Moves the boxes and updates the pairs. Returns their number; those of enlarged boxes count too.
    size_t update(const std::vector<Box>& boxes);

 private:
    struct Impl;
    std::unique_ptr<Impl> impl_;
};

}  // namespace trocar::bench
