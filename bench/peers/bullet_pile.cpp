// Bullet 3.24 (libbullet-dev), single precision.
#include "bench/peers/bullet_pile.hpp"

#include <memory>
#include <vector>

#include "bench/scale/bullet.hpp"

#ifdef TROCAR_WITH_BULLET
namespace {

constexpr uint32_t kSubsteps = 4;

struct Pile {
    btDefaultCollisionConfiguration configuration;
    btCollisionDispatcher dispatcher{&configuration};
    btDbvtBroadphase broadphase;
    btSequentialImpulseConstraintSolver solver;
    btDiscreteDynamicsWorld world{&dispatcher, &broadphase, &solver, &configuration};
    std::vector<std::unique_ptr<btBoxShape>> shape;
    std::vector<std::unique_ptr<btRigidBody>> body;
    double step = 0;
    int substeps = 0;
    ~Pile() {
        for (const auto& b : body) world.removeRigidBody(b.get());
    }
};

btVector3 vec(const double* v) { return {btScalar(v[0]), btScalar(v[1]), btScalar(v[2])}; }

void* make(const PileBox* box, uint32_t count, const PileSettings* settings) {
    auto pile = std::make_unique<Pile>();
    pile->step = settings->step;
    pile->substeps = int(settings->substeps);
    pile->world.setGravity(vec(settings->gravity));
    for (uint32_t i = 0; i < count; ++i) {
        const double *half = box[i].half, *q = box[i].orientation;
        pile->shape.push_back(std::make_unique<btBoxShape>(vec(half)));
        pile->shape.back()->setMargin(btScalar(5e-4));
        const double mass = box[i].free ? 8 * half[0] * half[1] * half[2] * settings->density : 0;
        btVector3 inertia(0, 0, 0);
        if (mass > 0) pile->shape.back()->calculateLocalInertia(btScalar(mass), inertia);
        btRigidBody::btRigidBodyConstructionInfo info(btScalar(mass), nullptr, pile->shape.back().get(), inertia);
        info.m_friction = btScalar(std::sqrt(settings->friction));  // of a pair: the product
        const btQuaternion turn{btScalar(q[0]), btScalar(q[1]), btScalar(q[2]), btScalar(q[3])};
        info.m_startWorldTransform = btTransform(turn, vec(box[i].position));
        pile->body.push_back(std::make_unique<btRigidBody>(info));
        pile->world.addRigidBody(pile->body.back().get());
    }
    return pile.release();
}

void step(void* handle) {
    auto* pile = static_cast<Pile*>(handle);
    pile->world.stepSimulation(btScalar(pile->step), pile->substeps, btScalar(pile->step / pile->substeps));
}

void poses(void* handle, double* pose) {
    for (const auto& body : static_cast<Pile*>(handle)->body) {
        const btVector3& at = body->getWorldTransform().getOrigin();
        const btQuaternion turn = body->getWorldTransform().getRotation();
        for (const double x :
             {double(at.x()), double(at.y()), double(at.z()), double(turn.x()), double(turn.y()), double(turn.z()), double(turn.w())})
            *pose++ = x;
    }
}

void destroy(void* pile) { delete static_cast<Pile*>(pile); }

}  // namespace

namespace trocar::bench {
PileEngine bullet_pile_engine() { return {"margin 0.5 mm", kSubsteps, make, step, poses, destroy}; }
}  // namespace trocar::bench
#endif
