#include "bench/peers/bullet_pairs.hpp"

#include <BulletCollision/BroadphaseCollision/btDbvtBroadphase.h>
#include <btBulletCollisionCommon.h>
namespace trocar::bench {

struct BulletPairs::Impl {
    btDefaultCollisionConfiguration configuration;
    btCollisionDispatcher dispatcher{&configuration};
    btDbvtBroadphase broadphase;
    std::vector<btBroadphaseProxy*> proxy;
};

namespace {
btVector3 to_bullet(const Vec3d& p) { return {btScalar(p.x()), btScalar(p.y()), btScalar(p.z())}; }
}  // namespace

BulletPairs::BulletPairs(const std::vector<Box>& boxes) : impl_(std::make_unique<Impl>()) {
    for (const Box& box : boxes) {
        impl_->proxy.push_back(impl_->broadphase.createProxy(to_bullet(box.min), to_bullet(box.max), 0, nullptr, 1, 1, &impl_->dispatcher));
    }
}

BulletPairs::~BulletPairs() {
    for (btBroadphaseProxy* proxy : impl_->proxy) impl_->broadphase.destroyProxy(proxy, &impl_->dispatcher);
}

size_t BulletPairs::update(const std::vector<Box>& boxes) {
    for (size_t i = 0; i < boxes.size(); ++i) {
        impl_->broadphase.setAabb(impl_->proxy[i], to_bullet(boxes[i].min), to_bullet(boxes[i].max), &impl_->dispatcher);
    }
    impl_->broadphase.calculateOverlappingPairs(&impl_->dispatcher);
    return size_t(impl_->broadphase.getOverlappingPairCache()->getNumOverlappingPairs());
}

}  // namespace trocar::bench
